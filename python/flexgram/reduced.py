"""The reduced body in Python: its matrices, error, response in frequency and time, and shapes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from flexgram.basics import BodyError, errors_of, expect_survival
from flexgram.error_form import ErrorForm
from flexgram.reduced_file import copy_file, port_names, read_fields
from flexgram.response import frequency_response, linear_response
from flexgram.words import error_of, label_of, table_of

if TYPE_CHECKING:
    from flexgram.physical import PhysicalForm

Floats = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: An output and its derivatives.
RATES = ("displacement", "velocity", "acceleration")


class Held(NamedTuple):
    """A body held at one interface (``ReducedModel.held``)."""

    omega: Floats
    compliance: float  # nan: no port is free
    port: str

    @property
    def frequency_error(self) -> float:
        """Largest relative error of the frequencies."""
        return float(np.abs(self.omega[:, 0] / self.omega[:, 1] - 1).max(initial=0))


def held_of(fields: dict[str, Any]) -> dict[str, Held]:
    """What the group /held says."""
    names = [str(name) for name in fields.get("held/interfaces", [])]
    omega = np.asarray(fields.get("held/omega", []), dtype=np.float64).reshape(-1, 2)
    counts = np.asarray(fields.get("held/frequencies", []), dtype=np.int64)
    parts = np.split(omega, np.cumsum(counts)[:-1]) if len(counts) else []
    return {name: Held(part, float(error), str(port)) for name, part, error, port in
            zip(names, parts, fields.get("held/compliance", []), fields.get("held/ports", []),
                strict=True)}  # fmt: skip


class ReducedModel:
    """A reduced elastic body ``M q'' + D q' + K (1 + i eta) q = B u``, ``y = C q``.

    Made by ``flexgram.reduce`` or read by ``ReducedModel.load``. All numbers are SI.

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
    omega, error, bound, floor : arrays
        Frequencies [rad/s], relative error of H there (eq. 17 of Fehr, Eberhard and Lehner), its
        certified bound and the part of the bound that is rounding; bound and floor are empty for
        ``pod``.
    kind : str
        ``certified``: everywhere in ``bands``; ``certified outside``: but for the intervals
        ``excluded`` around undamped resonances; or ``estimated``.
    certified_error : float
        Largest relative error everywhere in the bands, of H and of each kind of ports (``pod``:
        the largest one known, at ``omega``).
    attained_error : float
        The bound at one frequency ``attained_at`` [rad/s]: ``certified_error`` is no less.
    rigid_rounding : float
        How much H would change, relative to ‖H‖, if the stiffness that K holds of the rigid modes,
        which is within its rounding and taken for zero, were meant. Not part of the error.
    data_rounding : array
        How much H may change at ``omega``, relative, by the digits with which the FE code wrote K:
        an estimate, of the matrices themselves and not of the reduction, so not part of the error.
        Zero if K was not printed. Empty for ``pod``.
    relative_to : str
        What errors are divided by at each frequency: ``pointwise`` ‖H‖ (eq. 17); ``elastic`` ‖H‖
        without rigid motion; ``both`` the smaller of these; ``band`` the largest ‖H‖ of the band.
    bounds_elastic_part : bool
        Whether the error is small beside ‖H‖ without rigid motion: ``elastic`` or ``both``.
    bands, excluded : (n, 2) arrays
        [rad/s]
    excluded_poles : (n, 3) array
        Undamped resonances in ``excluded``: frequency [rad/s], how far at most the body's is from
        it, relative, and how far its residue, relative. Empty with a damping matrix.
    tolerance : float or None
        That was asked for; ``met`` tells whether the error of H and of each kind is within what was
        asked of it.
    unmet : (n, 2) array
        Intervals where the tolerance is not met [rad/s].
    whole_error : float
        The same of H as a whole, eq. (17), by itself.
    by_kind : (k,) array
        Largest bounds of each of ``kinds``: displacement from force, rotation from moment and so
        on; empty if the tolerance was for H as a whole, or none was given.
    unclaimed : list of str
        Kinds that nothing is claimed of by themselves (of assemblies). Of others that ``kinds``
        does not name H is nothing but rounding, if it names any.
    kind_tolerances : (k,) array
        What was asked of each, where kinds have tolerances of their own; else empty.
    held : dict of str to Held
        Of a free body with each interface held in turn, without damping: ``omega`` (k, 2), its
        frequencies in the bands [rad/s] and those of the medium model that it was cut from;
        ``compliance``, the largest relative error of what a load at a port moves that port by,
        statically, and that ``port``.
    field_inputs : list of str
        Kinds of inputs; ``field_error``: for each the largest error of the whole field that they
        cause, relative, in the norm of the strain energy (``-mor_field_error``); inf: not proved.
    loads : (n_in, k) array
        Loads P that the claim is for, each of unit norm: ‖Pᵀ(H − H_r)P‖ <= ε ‖PᵀHP‖ (where the
        outputs are not the inputs: (H − H_r)P); k = 0: each input by itself. ``load_names``.
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
        self.omega, self.error = array("error/omega"), array("error/relative")
        self.bound, self.floor = array("error/bound"), array("error/floor")
        self.kind = str(fields.get("error/kind", "estimated"))
        self.by_kind = array("error/by_kind")
        self.kind_tolerances = array("error/kind_tolerances")
        self.kinds: list[str] = [str(name) for name in fields.get("error/kinds", [])]
        self.unclaimed = [str(name) for name in fields.get("error/unclaimed", [])]
        self.field_inputs = [str(name) for name in fields.get("error/field_inputs", [])]
        self.field_error = array("error/field")
        self.held, self.form = held_of(fields), ErrorForm.of(fields)
        self.load_names = [str(name) for name in fields.get("loads/names", [])]
        self.loads = array("loads/patterns").reshape(self.B.shape[1], len(self.load_names))
        known = np.concatenate([self.bound if len(self.bound) else self.error, self.by_kind, [0]])
        self.certified_error = float(fields.get("error/worst", known.max()))
        self.whole_error = float(fields.get("error/whole", self.certified_error))
        self.attained_error = float(fields.get("error/attained", known.max()))
        self.attained_at = float(fields.get("error/at", np.nan))
        self.rigid_rounding = float(fields.get("error/rigid_rounding", 0.0))
        self.data_rounding = array("error/data_rounding")
        self.relative_to = str(fields.get("error/relative_to", "pointwise"))
        self.bounds_elastic_part = self.relative_to in ("elastic", "both")
        self.excluded = array("error/excluded").reshape(-1, 2)
        self.excluded_poles = array("error/poles").reshape(-1, 3)
        self.tolerance: float | None = fields.get("error/tolerance")
        self.met = bool(fields.get("error/met", True))
        self.unmet = array("error/unmet").reshape(-1, 2)
        self.sigma, self.modes = array("gramian/sigma"), array("modes/omega")
        self.band = array("band")
        self.bands = array("error/bands").reshape(-1, 2)
        if not len(self.bands):
            self.bands = self.band.reshape(-1, 2)
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
        self._stress_basis: tuple[Any, Floats, dict[str, Floats]] | None = None
        self.path: Path | None = None  #: where it was read from

    @classmethod
    def load(cls, path: str | Path, basis: bool = True) -> ReducedModel:
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

    @property
    def label(self) -> str:
        """What is claimed of the error, in words."""
        return label_of(self)

    def __repr__(self) -> str:
        return (f"<ReducedModel of order {self.order} by {self.method}, {len(self.inputs)} inputs, "
                f"{error_of(self)}>")  # fmt: skip

    def _repr_html_(self) -> str:
        """For notebooks: what ``info`` says."""
        return table_of(self)

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

    def stress(
        self,
        q: ArrayLike | None = None,
        body: str | Path | None = None,
        u: ArrayLike | None = None,
    ) -> Floats:
        """Stress at the nodes of a body that flexgram assembled, (k, N, 6) [N/m²].

        Of the elements' own strain, averaged at nodes (``flexgram.stress``): xx, yy, zz, xy, yz,
        zx; NaN at nodes of no deforming solid. Nothing is claimed of it but of ``outputs`` of the
        type stress; their values are these.

        Parameters
        ----------
        q : (k, m) array, optional
            Generalised coordinates; default: each basis vector.
        body : str or Path, optional
            Body file; default: the one that was reduced, if it is there.
        u : (k, n_in) array, optional
            Inputs at the same moments: needed if one of them is a temperature.

        Raises
        ------
        BodyError
            Without that file, or if it holds matrices; without ``u`` where heat strains the body.
        """
        from flexgram.geometry import Geometry, body_of
        from flexgram.stress import Stresses

        path = Path(body_of(self, body)).resolve()
        known = (path, path.stat().st_mtime_ns, path.stat().st_size) if path.exists() else None
        if self._stress_basis is None or self._stress_basis[0] != known:
            motion = Geometry.load(path).motion(self)
            stresses = Stresses.load(path)
            held = stresses.of_temperatures(path, self.inputs)
            self._stress_basis = (known, stresses.nodal(motion), held)
        _, basis, held = self._stress_basis
        if q is None:
            return basis.copy()
        states = np.atleast_2d(np.asarray(q))
        if np.iscomplexobj(states) or states.shape[1] != self.order:
            raise BodyError(
                f"stress: q is {' × '.join(map(str, states.shape))} of "
                f"{states.dtype}, expected real rows of {self.order} coordinates"
            )
        stress: Floats = np.tensordot(states.astype(float), basis, axes=1)
        if held:
            if u is None:
                raise BodyError(f"stress: {', '.join(held)} strains the body: give the inputs u of "
                                "these moments")  # fmt: skip
            loads = np.atleast_2d(np.asarray(u, dtype=float))
            if loads.shape != (len(states), len(self.inputs)):
                raise BodyError(f"stress: u is {' × '.join(map(str, loads.shape))}, expected "
                                f"{len(states)} × {len(self.inputs)} inputs")  # fmt: skip
            for name, field in held.items():
                stress += loads[:, self.inputs.index(name), None, None] * field
        return stress

    def physical(self) -> PhysicalForm:
        """The same body in the motions of its interfaces and the modes with these held, as
        superelements are.

        Raises
        ------
        BodyError
            If its coordinates do not hold every motion of its interfaces by itself.
        """
        from flexgram.physical import physical_form

        return physical_form(self)

    def elastic(self) -> ReducedModel:
        """The body in its own frame: without the rigid basis vectors. In a frame that is not
        ``buckens`` these are coupled with the others: no elastic part by itself
        (``without_rigid_modes``).

        Damping of the rigid motion by ``alpha M`` is left out.

        Raises
        ------
        BodyError
            If dampers hold the body against the ground, or if rigid motion is mixed into the basis
            (``-mor_frame none``, ``pod`` of a free body).
        """
        from flexgram.elastic_part import in_its_frame

        return in_its_frame(self)

    def without_rigid_modes(self) -> ReducedModel:
        """The body without its rigid modes, whatever its frame: the elastic part of H, stress too.

        Raises
        ------
        BodyError
            If dampers mix rigid and elastic modes.
        """
        from flexgram.elastic_part import without_rigid_modes

        return without_rigid_modes(self)

    def replaced(self, **fields: Any) -> ReducedModel:
        """A copy with other fields: of fewer vectors, or of other ports."""
        other = object.__new__(ReducedModel)
        other.__dict__.update(self.__dict__ | fields)
        other._stress_basis = None
        return other

    def plot(self, figure: str = "error", path: str | Path | None = None, **options: Any) -> Any:
        """Draw ``error``, ``gramian``, ``transfer``, ``stages`` or ``shapes``.

        Parameters
        ----------
        figure : str
            Which one; ``flexgram.figures`` has their options (``sweep``, ``ports``, ``body``).
        path : str or Path, optional
            Write it there, as ``.png``, ``.svg`` or ``.pdf``.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from flexgram import figures  # matplotlib is slow to load

        if figure not in figures.FIGURES:
            raise BodyError(f"plot: {figure} must be one of {', '.join(figures.FIGURES)}")
        drawn = figures.FIGURES[figure](self, **options)
        if path is not None:
            figures.save(drawn, Path(path))
        return drawn

    def save(self, path: str | Path) -> None:
        """Write the reduced file; collective on the communicator of ``reduce``."""
        if self._save is None:
            raise BodyError("a copied or unpickled body has no file of its own: export it "
                            "(flexgram.export), or save the original")  # fmt: skip
        self._save(str(path))
