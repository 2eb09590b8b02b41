"""The reduced body: its matrices, claim, response in frequency and time, and shapes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from flexgram.basics import BodyError, errors_of, expect_survival
from flexgram.model.claim import Claim
from flexgram.model.file import copy_file, port_names, read_fields
from flexgram.model.response import frequency_response, linear_response

Floats = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: An output and its derivatives.
RATES = ("displacement", "velocity", "acceleration")


class ReducedBody:
    """A reduced elastic body ``M q'' + D q' + K (1 + i eta) q = B u``, ``y = C q``.

    What its verbs are for users stands in ``flexgram.ReducedModel``. All numbers are SI.

    Attributes
    ----------
    M, D, K : (m, m) arrays
        Mass, damping (Rayleigh and other, summed), stiffness; symmetric.
    B, C : (m, n_in), (n_out, m) arrays
        Input and output maps.
    feedthrough : (n_out, n_in) array
        What inputs add to outputs without motion: of a temperature the stress that its strain does
        not make. Part of ``transfer`` and ``simulate``, not of the H that errors are relative to.
    eta : float
        Structural loss factor.
    V : (rows, m) array
        Basis: full displacements are ``V q``. After a parallel ``reduce`` the rows of this rank.
    node, component, position : arrays
        For the rows of V the label of the node, 0-2 (translation) or 3-5 (rotation), and its place
        (rows, 3) [m]; empty for a body without a dof map.
    inputs, outputs : list of str
        Port names.
    claim : Claim
        What is claimed of the error.
    sigma : array
        Eigenvalues of the position Gramian, descending.
    modes : array
        Undamped eigenfrequencies of the reduced body [rad/s].
    band : (2,) array
        [rad/s]
    method, second_stage : str
        As in the options of flexgram.
    frame : dict
        ``kind``, ``rigid_modes``, and for a body that can move the integrals of a floating frame
        (``mass``, ``centre``, ``M_r``, ``M_er``, ``gyroscopic``, ``inertia_first``,
        ``inertia_second``; definitions in ``src/model/frame_integrals.hpp``).
    log : dict
        Seconds by stage, warnings, factorisations, body.
    """

    def __init__(self, fields: dict[str, Any], save: Callable[[str], None] | None) -> None:
        def array(name: str) -> Floats:
            return np.asarray(fields.get(name, []), dtype=np.float64)

        self.M, self.D, self.K = array("M"), array("D"), array("K")
        self.B, self.C, self.V = array("B"), array("C"), array("V")
        self.eta = float(fields.get("eta", 0.0))
        self.inputs: list[str] = port_names(fields, "B", self.B.shape[1])
        self.outputs: list[str] = port_names(fields, "C", self.C.shape[0])
        none = np.zeros((self.C.shape[0], self.B.shape[1]))
        self.feedthrough = np.asarray(fields.get("feedthrough", none), dtype=np.float64)
        self.claim = Claim.of(fields, self.B.shape[1])
        self.sigma, self.modes = array("gramian/sigma"), array("modes/omega")
        self.band = array("band")
        self.method = str(fields.get("method", ""))
        self.second_stage = str(fields.get("second_stage", ""))
        self.node = np.asarray(fields.get("dofs/node", []), dtype=np.int64)
        self.component = np.asarray(fields.get("dofs/component", []), dtype=np.int64)
        self.position = array("dofs/position").reshape(-1, 3)
        names = ("mass", "centre", "M_r", "M_er", "gyroscopic", "inertia_first", "inertia_second")
        self.frame: dict[str, Any] = {
            name: np.asarray(fields[f"frame/{name}"]) for name in names if f"frame/{name}" in fields
        }
        self.frame["kind"] = str(fields.get("frame/kind", "none"))
        self.frame["rigid_modes"] = int(fields.get("frame/rigid_modes", 0))
        self.log: dict[str, Any] = {
            name.removeprefix("log/"): value
            for name, value in fields.items()
            if name.startswith("log/")
        }
        if "plan" in self.log:  # "name<tab>value"
            self.log["plan"] = [tuple(str(line).split("\t", 1)) for line in self.log["plan"]]
        self._save = save
        #: Stress of the basis vectors by the file that it is of (``recovery``).
        self.recovered: tuple[Any, Floats, dict[str, Floats]] | None = None
        self.path: Path | None = None  #: where it was read from

    @classmethod
    def load(cls, path: str | Path, basis: bool = True) -> Self:
        """Read a reduced file.

        Parameters
        ----------
        path : str or Path
            What ``flexgram reduce`` or ``save`` wrote.
        basis : bool
            Read V too, the only large part.

        Raises
        ------
        BodyError
            If the file is missing or no reduced file.
        """
        source = Path(path)
        path = source
        if not path.exists():
            raise BodyError(f"{path}: no such file")
        if not h5py.is_hdf5(path):
            raise BodyError(f"{path}: not an HDF5 file")
        expect_survival(source, lambda: read_fields(source, False))
        with errors_of(path):
            fields = read_fields(path, basis)
        with errors_of(path):
            model = cls(fields, lambda target: copy_file(source, Path(target)))
            model._expect_shapes()
        model.path = source
        return model

    def _expect_shapes(self) -> None:
        """What a file must hold for anything else here to make sense."""
        m, n_in, n_out = len(self.K), len(self.inputs), len(self.outputs)
        shapes = {"M": (m, m), "D": (m, m), "K": (m, m), "B": (m, n_in), "C": (n_out, m),
                  "feedthrough": (n_out, n_in)}  # fmt: skip
        for name, shape in shapes.items():
            matrix = getattr(self, name)
            if matrix.shape != shape:
                raise BodyError(f"{name} is {matrix.shape}, expected {shape}")
            if not np.all(np.isfinite(matrix)):
                raise BodyError(f"{name} holds NaN or Inf")

    @property
    def order(self) -> int:
        """Number m of generalised coordinates."""
        return int(self.K.shape[0])

    def __repr__(self) -> str:
        return (f"<{type(self).__name__} of order {self.order} by {self.method}, "
                f"{len(self.inputs)} inputs, {self.claim.words}>")  # fmt: skip

    def __getstate__(self) -> dict[str, Any]:
        """For pickle and copy: all numbers; what wrote the file of this one stays behind."""
        return self.__dict__ | {"_save": None, "V": np.array(self.V)}

    def transfer(self, omega: ArrayLike, feedthrough: bool = True) -> ComplexArray:
        """Transfer function H_r = C (K (1 + i eta) + i omega D - omega² M)⁻¹ B + ``feedthrough``.

        Parameters
        ----------
        omega : float or (n,) array
            [rad/s]
        feedthrough : bool
            Without it the H that errors are relative to.

        Returns
        -------
        (n_out, n_in) or (n, n_out, n_in) array
        """
        H = frequency_response(self.K * (1 + 1j * self.eta), self.D, self.M, self.B, self.C, omega)
        return H + self.feedthrough if feedthrough else H

    def poles(self) -> ComplexArray:
        """The 2m poles s [rad/s] of the body without structural damping, by rising ``|s|``."""
        m = self.order
        zero, one = np.zeros((m, m)), np.eye(m)
        s: ComplexArray = scipy.linalg.eigvals(np.block([[zero, one], [-self.K, -self.D]]),
                                 np.block([[one, zero], [zero, self.M]]))  # fmt: skip
        s = s[np.argsort(np.abs(s))]
        return s

    def expect_time_domain(self, rates: Sequence[str]) -> None:
        """Raise BodyError where there is no real state space with these rates of the outputs."""
        if self.eta:
            raise BodyError(f"structural damping (eta = {self.eta:g}) has no real time-domain "
                            "form: give Rayleigh damping instead")  # fmt: skip
        if not rates or set(rates) - set(RATES):
            raise BodyError(f"rates are {', '.join(rates) or 'none'}, expected some of "
                            f"{', '.join(RATES)}")  # fmt: skip
        if self.feedthrough.any() and set(rates) != {"displacement"}:
            raise BodyError("outputs with a feedthrough (stress of a temperature, reactions) have "
                            "rates that hang on those of the inputs: leave these ports out, or "
                            "take displacement alone")  # fmt: skip

    def state_space(
        self, rates: Sequence[str] = ("displacement",)
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """A, B, C, D of x' = A x + B u, y = C x + D u with x = [q, q'].

        Parameters
        ----------
        rates : sequence of str
            What y holds of all outputs, one after the other: ``displacement`` (the outputs
            themselves), ``velocity``, ``acceleration`` (their derivatives). Relative errors at a
            frequency are those of the outputs.

        Raises
        ------
        BodyError
            With structural damping, which has no real state space; for rates of outputs with a
            feedthrough, which would be rates of the inputs.
        """
        self.expect_time_domain(rates)
        m = self.order
        mass = scipy.linalg.cho_factor(self.M)
        A = np.zeros((2 * m, 2 * m))
        A[:m, m:] = np.eye(m)
        A[m:, :m] = -scipy.linalg.cho_solve(mass, self.K)
        A[m:, m:] = -scipy.linalg.cho_solve(mass, self.D)
        B = np.vstack([np.zeros_like(self.B), scipy.linalg.cho_solve(mass, self.B)])
        zero = np.zeros_like(self.C)
        rows = {
            "displacement": (np.hstack([self.C, zero]), self.feedthrough),
            "velocity": (np.hstack([zero, self.C]), np.zeros_like(self.feedthrough)),
            "acceleration": (self.C @ A[m:], self.C @ B[m:]),
        }
        return A, B, np.vstack([rows[r][0] for r in rates]), np.vstack([rows[r][1] for r in rates])

    def names_of(self, rates: Sequence[str]) -> list[str]:
        """Names of outputs and their rates, as ``state_space`` and ``simulate`` order them."""
        end = {"displacement": "", "velocity": "'", "acceleration": "''"}
        return [name + end[rate] for rate in rates for name in self.outputs]

    def simulate(
        self,
        u: Callable[[float], ArrayLike] | ArrayLike,
        t: ArrayLike,
        q0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        rates: Sequence[str] = ("displacement",),
    ) -> tuple[Floats, Floats]:
        """Response to forces over time: exact for inputs that are linear between the times.

        Parameters
        ----------
        u : callable or (n_t, n_in) array
            Forces at the ports [N, N m].
        t : (n_t,) array
            Times [s], evenly spaced.
        q0, v0 : (m,) arrays, optional
            Initial coordinates and velocities; default zero.
        rates : sequence of str
            As of ``state_space``.

        Returns
        -------
        y : (n_t, n_out) array
            Outputs; of several rates one after the other (``names_of``).
        q : (n_t, m) array
            Generalised coordinates; ``lift`` makes displacements of them.
        """
        times = np.asarray(t, dtype=float)
        steps = np.diff(times)
        if len(steps) == 0 or not np.all(steps > 0) or np.ptp(steps) > 1e-9 * steps[0]:
            raise BodyError("simulate: t must be two or more evenly spaced, rising times")
        forces = np.array([np.ravel(u(x)) for x in times] if callable(u) else u, dtype=float)
        if forces.ndim == 1:
            forces = forces[:, None]
        if forces.shape != (len(times), self.B.shape[1]):
            raise BodyError(f"simulate: u is {' × '.join(map(str, forces.shape))}, expected "
                            f"{len(times)} times × {self.B.shape[1]} inputs: "
                            f"{', '.join(self.inputs)}")  # fmt: skip
        A, B, C, D = self.state_space(rates)
        m = self.order
        start = np.zeros(2 * m)
        start[:m] = 0 if q0 is None else q0
        start[m:] = 0 if v0 is None else v0
        x = linear_response(A, B, start, forces, steps[0])
        return x @ C.T + forces @ D.T, x[:, :m]

    def lift(self, q: ArrayLike) -> Floats:
        """Displacements V q of the full body, (…, m) -> (…, rows of V)."""
        return np.asarray(q, dtype=float) @ self.V.T

    def nodal(self, vectors: ArrayLike | None = None) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Nodes with their translations in given coordinates, for pictures and exporters.

        Parameters
        ----------
        vectors : (k, m) array, optional
            Generalised coordinates; default: each basis vector.

        Returns
        -------
        labels : (N,) int array
        points : (N, 3) array
            [m]
        motion : (k, N, 3) array
            Translations; zero where a node has no free dof.

        Raises
        ------
        BodyError
            For a body without a dof map.
        """
        if not len(self.position) or len(self.component) != len(self.V):
            raise BodyError("the body has no dof map or coordinates: its shapes cannot be drawn")
        shapes = np.atleast_2d(np.eye(self.order) if vectors is None else np.asarray(vectors))
        labels, first, at = np.unique(self.node, return_index=True, return_inverse=True)
        motion = np.zeros((len(shapes), len(labels), 3))
        moves = self.component < 3
        motion[:, at[moves], self.component[moves]] = self.lift(shapes)[:, moves]
        return labels, self.position[first], motion

    def replaced(self, **fields: Any) -> Self:
        """A copy with other fields: of fewer vectors, or of other ports."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__ | fields)
        other.recovered = None
        return other

    def save(self, path: str | Path) -> None:
        """Write the reduced file; collective on the communicator of ``reduce``."""
        if self._save is None:
            raise BodyError("a copied or unpickled body has no file of its own: export it "
                            "(flexgram.export), or save the original")  # fmt: skip
        self._save(str(path))
