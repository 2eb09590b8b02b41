"""The equations of a reduced body, and their answers in frequency and time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, ComplexArray, Floats
from flexgram.body.laws import Circulatory, Loss, Prony, Viscous
from flexgram.body.terms import Term, law_of
from flexgram.body.varying_laws import Coriolis, Parameter, Product, Spin, Varying
from flexgram.model.file import port_names
from flexgram.model.internal_states import InternalStates
from flexgram.model.kinds import ports_of
from flexgram.model.modes import massless
from flexgram.model.response import frequency_response, linear_response

#: An output and its derivatives.
RATES = ("displacement", "velocity", "acceleration")


def expect_frequencies(omega: ArrayLike) -> None:
    """Raise BodyError for what is no frequency [rad/s]: NaN, infinite, complex."""
    values = np.asarray(omega)
    if values.dtype.kind not in "iuf" or not np.all(np.isfinite(values)):
        raise BodyError(f"omega = {omega!r}: frequencies are finite real numbers [rad/s]")


def _terms_of(fields: dict[str, Any]) -> tuple[Term, ...]:
    """Of the fields of a reduced body: terms/NAME, a matrix, its law and its numbers."""
    terms = []
    for name in sorted(key[6:] for key in fields if key.startswith("terms/")):
        if "/" in name:
            continue
        path = f"terms/{name}"
        numbers = {
            key[len(path) + 1 :]: x for key, x in fields.items() if key.startswith(path + "/")
        }
        law = law_of(str(numbers.get("law")), numbers, path)
        terms.append(Term(name, law, np.asarray(fields[path], dtype=np.float64)))
    return tuple(terms)


@dataclass(frozen=True)
class System:
    """``M q'' + D q' + (K (1 + i eta) + i S + Σ g(ω) T) q = B u``. All numbers are SI.

    Outputs are ``y = C q + output_beta C q' + feedthrough u``, with structural damping in addition
    ``i output_eta C q``. ``C q`` alone is the whole output only where the other terms are zero: not
    for reactions, nor for stress from a temperature.

    Attributes
    ----------
    M, D, K : (m, m) arrays
        Mass, damping (Rayleigh and other, summed), stiffness; symmetric, but for gyroscopic forces
        in D.
    B, C : (m, n_in), (n_out, m) arrays
        Input and output maps.
    inputs, outputs : list of str
        Port names.
    feedthrough : (n_out, n_in) array
        What inputs add to outputs without motion: of a temperature the stress that its strain does
        not make, of reactions often the largest part. Part of every response and of H.
    eta : float
        Structural loss factor.
    S : (m, m) array
        Structural damping of materials with loss factors of their own, the imaginary part of the
        stiffness [N/m]; zero where there are none.
    terms : tuple of Term
        Matrices T, (m, m), with laws g of their own: viscoelastic materials.
    output_beta, output_eta : (n_out,) arrays
        Stiffness-proportional damping [s] and loss factor of outputs that are forces of the
        stiffness (reactions); zero for all others.
    """

    M: Floats
    D: Floats
    K: Floats
    B: Floats
    C: Floats
    inputs: list[str]
    outputs: list[str]
    feedthrough: Floats
    eta: float = 0.0
    output_beta: Floats = field(default_factory=lambda: np.empty(0))
    output_eta: Floats = field(default_factory=lambda: np.empty(0))
    S: Floats = field(default_factory=lambda: np.empty(0))
    terms: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        if not self.S.size:
            object.__setattr__(self, "S", np.zeros_like(self.K))
        for name in ("output_beta", "output_eta"):
            if not getattr(self, name).size:
                object.__setattr__(self, name, np.zeros(len(self.C)))

    @classmethod
    def of(cls, fields: dict[str, Any]) -> Self:
        """From the fields of a reduced body.

        Raises
        ------
        BodyError
            If its matrices do not fit each other, or hold NaN or Inf.
        """
        M, D, K, B, C = (np.asarray(fields.get(x, []), dtype=np.float64) for x in "MDKBC")
        none = np.zeros((C.shape[0], B.shape[1]))
        system = cls(
            M,
            D,
            K,
            B,
            C,
            inputs=port_names(fields, "B", B.shape[1]),
            outputs=port_names(fields, "C", C.shape[0]),
            feedthrough=np.asarray(fields.get("feedthrough", none), dtype=np.float64),
            eta=float(fields.get("eta", 0.0)),
            output_beta=np.asarray(fields.get("output_beta", []), dtype=np.float64),
            output_eta=np.asarray(fields.get("output_eta", []), dtype=np.float64),
            S=np.asarray(fields.get("S", []), dtype=np.float64),
            terms=_terms_of(fields),
        )
        system._expect_shapes()
        return system

    def _expect_shapes(self) -> None:
        """What anything else here relies on."""
        m, n_in, n_out = len(self.K), len(self.inputs), len(self.outputs)
        shapes = {
            "M": (m, m),
            "D": (m, m),
            "K": (m, m),
            "S": (m, m),
            "B": (m, n_in),
            "C": (n_out, m),
            "feedthrough": (n_out, n_in),
            "output_beta": (n_out,),
            "output_eta": (n_out,),
        }
        for name, shape in shapes.items():
            matrix = getattr(self, name)
            if matrix.shape != shape:
                raise BodyError(f"{name} is {matrix.shape}, expected {shape}")
            if not np.all(np.isfinite(matrix)):
                raise BodyError(f"{name} holds NaN or Inf")
        for term in self.terms:
            if np.shape(term.matrix) != (m, m) or not np.all(np.isfinite(term.matrix)):
                raise BodyError(f"term {term.name} must be a finite matrix, {m} × {m}")
        for name in ("output_beta", "output_eta"):
            if np.any(getattr(self, name) < 0):
                raise BodyError(f"{name} holds a negative damping")

    @property
    def order(self) -> int:
        """Number m of generalised coordinates."""
        return int(self.K.shape[0])

    def projected(self, Q: Floats) -> Self:
        """The system in the coordinates p of q = Q p."""
        return replace(
            self,
            M=Q.T @ self.M @ Q,
            D=Q.T @ self.D @ Q,
            K=Q.T @ self.K @ Q,
            S=Q.T @ self.S @ Q,
            terms=self.terms_by(lambda T: Q.T @ T @ Q),
            B=Q.T @ self.B,
            C=self.C @ Q,
        )

    def without_first(self, count: int) -> Self:
        """The system without its first coordinates."""
        keep = slice(count, None)
        return replace(
            self,
            M=self.M[keep, keep],
            D=self.D[keep, keep],
            K=self.K[keep, keep],
            S=self.S[keep, keep],
            terms=self.terms_by(lambda T: T[keep, keep]),
            B=self.B[keep],
            C=self.C[:, keep],
        )

    def terms_by(self, change: Callable[[Floats], Floats]) -> tuple[Term, ...]:
        """The terms, each matrix changed."""
        return tuple(term.with_matrix(change(term.matrix)) for term in self.terms)

    @property
    def parameters(self) -> dict[str, Varying]:
        """A law that depends on it of each parameter, by its name."""
        found: dict[str, Varying] = {}
        for term in self.terms:
            if isinstance(term.law, Varying):
                found.setdefault(term.law.parameter(term.name), term.law)
        return found

    def at(self, values: Mapping[str, float] | None = None) -> Self:
        """The system without parameters: each has a value, the given one or its present one.

        Raises
        ------
        BodyError
            For a name that is no parameter, or a value that is not between its two numbers.
        """
        known = self.parameters
        for name in values or {}:
            if name not in known:
                raise BodyError(
                    f"{name} is no parameter of the body; it has {', '.join(known) or 'none'}"
                )
        K, D, S, others = self.K, self.D, self.S, []
        for term in self.terms:
            law = term.law
            if not isinstance(law, Varying):
                others.append(term)
                continue
            name = law.parameter(term.name)
            law = law.with_value((values or {}).get(name, law.value), name)
            if isinstance(law, Coriolis):
                D = D + law.value * term.matrix
                continue
            if isinstance(law, Product):
                now = law.times * term.matrix
                if isinstance(law.factor, Viscous):
                    D = D + now
                elif isinstance(law.factor, Loss):
                    S = S + now
                else:
                    others.append(Term(term.name, law.factor, now))
                continue
            assert isinstance(law, (Parameter, Spin))
            stiffer = law.stiffness * term.matrix
            K = K + stiffer
            if not isinstance(law, Parameter):
                if self.eta:  # which is of K as it was
                    S = S - self.eta * stiffer
                continue
            if law.beta:
                D = D + law.beta * stiffer
            if loss := law.loss + law.eta - self.eta:
                S = S + loss * stiffer
        return replace(self, K=K, D=D, S=S, terms=tuple(others))

    def in_time(self) -> Self:
        """The system without parameters, with circulatory forces in K, which is then not
        symmetric."""
        now = self.at()
        K, S = now.K, now.S
        for term in now.terms:
            if isinstance(term.law, Circulatory):
                K, S = K + term.matrix, S - self.eta * term.matrix
        others = tuple(term for term in now.terms if not isinstance(term.law, Circulatory))
        return replace(now, K=K, S=S, terms=others)

    @property
    def is_in_time(self) -> bool:
        """Whether ``in_time`` changes nothing."""
        return not any(isinstance(term.law, (Varying, Circulatory)) for term in self.terms)

    def along(self, loads: Floats, names: list[str]) -> Self:
        """The system with combinations of its inputs, (n_in, k), for inputs; and with the same of
        its outputs where these are the inputs."""
        system = replace(self, inputs=names, B=self.B @ loads, feedthrough=self.feedthrough @ loads)
        if self.outputs != self.inputs:
            return system
        return replace(
            system, outputs=names, C=loads.T @ system.C, feedthrough=loads.T @ system.feedthrough
        )

    def transfer(self, omega: ArrayLike, feedthrough: bool = True) -> ComplexArray:
        """Transfer function H_r = F C (``dynamic_stiffness``)⁻¹ B + ``feedthrough``,
        F = diag(1 + i ``output_eta`` + i omega ``output_beta``).

        Parameters
        ----------
        omega : float or (n,) array
            [rad/s]
        feedthrough : bool
            False leaves the last term out.

        Returns
        -------
        (n_out, n_in) or (n, n_out, n_in) array
        """
        H = self.receptance(omega)
        if self.has_damped_outputs:
            H = H * self.output_factors(omega)[..., None]
        return H + self.feedthrough if feedthrough else H

    def claimed(self, omega: ArrayLike) -> ComplexArray:
        """The H that claims are relative to: of stress that of the whole strain, without what a
        temperature adds to it at once (where a body is free to grow both cancel)."""
        H: ComplexArray = self.transfer(omega, feedthrough=False) + self.claimed_feedthrough
        return H

    @property
    def claimed_feedthrough(self) -> Floats:
        """``feedthrough`` with zeros in the rows of stress."""
        direct = self.feedthrough.copy()
        direct[ports_of(self.outputs, "stress")] = 0
        return direct

    @property
    def loss(self) -> str:
        """What K, D and M do not hold, in words: a loss factor, those of materials, terms with laws
        of their own; else empty. Parameters have their present values."""
        if self.parameters:
            return self.at().loss
        words = [f"eta = {self.eta:g}"] if self.eta else []
        words += ["S, by material"] if self.S.any() else []
        return ", ".join(
            [
                *words,
                *(
                    term.law.words
                    if isinstance(term.law, Circulatory)
                    else f"{term.name}, viscoelastic: {term.law.words}"
                    for term in self.terms
                ),
            ]
        )

    @property
    def timeless(self) -> str:
        """What has no time domain, in words: ``loss`` without Prony terms."""
        now = self.at()
        relaxing = tuple(term for term in now.terms if not isinstance(term.law, Prony))
        return replace(now, terms=relaxing).loss

    @property
    def is_gyroscopic(self) -> bool:
        """Whether forces are gyroscopic or circulatory: D has a skew part, or a term is one."""
        laws = [getattr(term.law, "factor", term.law) for term in self.terms]  # of products, theirs
        if any(isinstance(law, (Coriolis, Circulatory)) for law in laws):
            return True
        return bool(abs(self.D - self.D.T).max(initial=0) > 1e-12 * abs(self.D).max(initial=0))

    def expect_symmetric(self, what: str) -> None:
        """Raise BodyError where D is not symmetric, or a term."""
        if self.is_gyroscopic:
            raise BodyError(
                f"{what} takes symmetric matrices only; gyroscopic and circulatory forces are skew"
            )

    def complex_stiffness(self, omega: float) -> ComplexArray:
        """K (1 + i eta) + i S + Σ g(omega) T, (m, m)."""
        stiffness: ComplexArray = self.K * (1 + 1j * self.eta)
        if self.S.any():
            stiffness = stiffness + 1j * self.S
        for term in self.terms:
            stiffness = stiffness + complex(term.law.at(omega)) * term.matrix
        return stiffness

    def receptance(self, omega: ArrayLike) -> ComplexArray:
        """C (``dynamic_stiffness``)⁻¹ B: H without what outputs hold beside C q."""
        expect_frequencies(omega)
        stiffness = self.complex_stiffness if self.terms else self.complex_stiffness(0.0)
        H: ComplexArray = frequency_response(stiffness, self.D, self.M, self.B, self.C, omega)
        return H

    @property
    def has_damped_outputs(self) -> bool:
        """Whether an output is a force of the damped stiffness."""
        return bool(self.output_beta.any() or self.output_eta.any())

    def output_factors(self, omega: ArrayLike) -> ComplexArray:
        """1 + i output_eta + i omega output_beta, (n_out,) or (n, n_out)."""
        w = np.asarray(omega, dtype=float)[..., None]
        factors: ComplexArray = 1 + 1j * (self.output_eta + w * self.output_beta)
        return factors

    def dynamic_stiffness(self, omega: float) -> ComplexArray:
        """``complex_stiffness`` + i omega D - omega² M, (m, m)."""
        Z: ComplexArray = (
            self.complex_stiffness(omega) + 1j * omega * self.D - omega * omega * self.M
        )
        return Z

    def poles(self) -> ComplexArray:
        """The 2m poles s [rad/s] of the body without structural damping and tables, by rising
        ``|s|``; with Prony terms also those of its internal states. Parameters have their present
        values, here and in time."""
        if not self.is_in_time:
            return self.in_time().poles()
        m = self.order
        inner = InternalStates.of(self.terms, m)
        A = np.zeros((2 * m + inner.count, 2 * m + inner.count))
        A[:m, m : 2 * m] = np.eye(m)
        A[m : 2 * m, :m], A[m : 2 * m, m : 2 * m] = -self.K - inner.stiffness, -self.D
        A[m : 2 * m, 2 * m :], A[2 * m :, :m] = inner.force, inner.drive
        A[2 * m :, 2 * m :] = -np.diag(inner.rate)
        mass = scipy.linalg.block_diag(np.eye(m), self.M, np.eye(inner.count))
        s: ComplexArray = scipy.linalg.eigvals(A, mass)
        s = s[np.argsort(np.abs(s))]
        return s

    def expect_time_domain(self, rates: Sequence[str]) -> None:
        """Raise BodyError where there is no real state space with these rates of the outputs."""
        if self.timeless:
            raise BodyError(
                f"structural damping ({self.timeless}) has no real time-domain "
                "form: give Rayleigh damping or Prony terms instead, or take an equivalent "
                "(export --damping modal, flexgram.model.equivalent_damping)"
            )
        if light := massless(self.K, self.M):
            raise BodyError(
                f"{light} of the {self.order} coordinates have no mass (scalar points, rotations "
                "without inertia), so that there is no state space: condense them before the "
                "reduction (Nastran OMIT, Guyan), or give them mass (where it is lumped: "
                "PARAM,COUPMASS,1, or mass_integration: full)"
            )
        if not rates or set(rates) - set(RATES):
            raise BodyError(
                f"rates are {', '.join(rates) or 'none'}, expected some of {', '.join(RATES)}"
            )
        direct = self.feedthrough.any(axis=1) | (self.output_beta != 0)
        if direct.any() and set(rates) != {"displacement"}:
            raise BodyError(
                f"output {self.outputs[int(np.argmax(direct))]} depends on inputs or velocities "
                "directly (stress of a temperature, reactions), so its rates depend on rates of "
                "the inputs: leave it out, or ask for displacement alone"
            )

    def state_space(
        self, rates: Sequence[str] = ("displacement",)
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """A, B, C, D of x' = A x + B u, y = C x + D u with x = [q, q'], and behind them the
        internal states of Prony terms (``InternalStates``).

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
        if not self.is_in_time:
            return self.in_time().state_space(rates)
        self.expect_time_domain(rates)
        m = self.order
        mass = scipy.linalg.cho_factor(self.M)
        inner = InternalStates.of(self.terms, m)
        A = np.zeros((2 * m + inner.count, 2 * m + inner.count))
        A[:m, m : 2 * m] = np.eye(m)
        A[m : 2 * m, :m] = -scipy.linalg.cho_solve(mass, self.K + inner.stiffness)
        A[m : 2 * m, m : 2 * m] = -scipy.linalg.cho_solve(mass, self.D)
        A[m : 2 * m, 2 * m :] = scipy.linalg.cho_solve(mass, inner.force)
        A[2 * m :, :m] = inner.drive
        A[2 * m :, 2 * m :] = -np.diag(inner.rate)
        B = np.zeros((len(A), self.B.shape[1]))
        B[m : 2 * m] = scipy.linalg.cho_solve(mass, self.B)
        zero, none = np.zeros_like(self.C), np.zeros((len(self.C), inner.count))
        rows = {
            "displacement": (np.hstack([self.C, self.C_rate, none]), self.feedthrough),
            "velocity": (np.hstack([zero, self.C, none]), np.zeros_like(self.feedthrough)),
            "acceleration": (self.C @ A[m : 2 * m], self.C @ B[m : 2 * m]),
        }
        return A, B, np.vstack([rows[r][0] for r in rates]), np.vstack([rows[r][1] for r in rates])

    @property
    def C_rate(self) -> Floats:
        """What outputs take of the velocities: diag(``output_beta``) C, (n_out, m)."""
        rows: Floats = self.output_beta[:, None] * self.C
        return rows

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
            Initial coordinates and velocities; default zero. Prony terms start relaxed.
        rates : sequence of str
            As of ``state_space``.

        Returns
        -------
        y : (n_t, n_out) array
            Outputs; of several rates one after the other (``names_of``).
        q : (n_t, m) array
            Generalised coordinates; ``Basis.lift`` makes displacements of them.
        """
        if np.iscomplexobj(t):
            raise BodyError("simulate: t holds complex numbers")
        times = np.asarray(t, dtype=float)
        steps = np.diff(times)
        if len(steps) == 0 or not np.all(steps > 0) or np.ptp(steps) > 1e-9 * steps[0]:
            raise BodyError("simulate: t must be two or more evenly spaced, rising times")
        given = np.asarray([np.ravel(u(x)) for x in times] if callable(u) else u)
        if given.dtype.kind == "c" or not np.all(np.isfinite(given.astype(float))):
            raise BodyError("simulate: u holds NaN, infinite or complex numbers")
        forces = given.astype(float)
        if forces.ndim == 1:
            forces = forces[:, None]
        if forces.shape != (len(times), self.B.shape[1]):
            raise BodyError(
                f"simulate: u is {' × '.join(map(str, forces.shape))}, expected "
                f"{len(times)} times × {self.B.shape[1]} inputs: "
                f"{', '.join(self.inputs)}"
            )
        A, B, C, D = self.state_space(rates)
        m = self.order
        start = np.zeros(len(A))
        start[:m] = 0 if q0 is None else q0
        start[m : 2 * m] = 0 if v0 is None else v0
        inner = InternalStates.of(self.terms, m)
        start[2 * m :] = (inner.drive @ start[:m]) / inner.rate
        x = linear_response(A, B, start, forces, steps[0])
        return x @ C.T + forces @ D.T, x[:, :m]
