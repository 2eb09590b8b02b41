"""Random systems against extended precision: does any true error exceed the certified one?

    audit.py [count] [seed] [csv] [--materials | --mixtures | --spin | --speeds]
             [--every N] [--from N]
        count systems, or every Nth of them, from the Nth on; a table by class and by damping

``--materials``: with loss factors by material instead of the seven other kinds of damping;
``--mixtures``: several of these at once;
``--spin``: with gyroscopic forces; ``--speeds``: with a range of speeds.

Each system is reduced in this process, with its tolerance and nothing else; the referee chooses
frequencies against the result (``referee.py``).
"""

from __future__ import annotations

import collections
import csv
import sys
import time
import warnings
from dataclasses import dataclass, field
from typing import Any

import mpmath
import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp

import flexgram
from flexgram.basics import BodyError
from referee import LONG, TWO_PI, System, hard_frequencies, relative_error

CLASSES = (
    "chain",
    "graph",
    "modal",
    "clustered",
    "massless",
    "soft mounts",
    "free",
    "elastic part",
    "weak ports",
    "scaled ports",
    "other outputs",
    "two bands",
    "mode on cutoff",
    "many ports",
    "many outputs",
    "printed",
)
DAMPINGS = ("none", "mass", "stiffness", "both", "structural", "dashpots", "general")
#: S = Σ η_k K_k of random positive semidefinite parts of K, alone or with others, --materials.
#: And viscoelastic ones, of such parts; and parts known between two numbers.
MATERIALS = (
    *("materials", "materials and dashpots", "materials and mass"),
    *("relaxation", "relaxation and materials", "a table", "a table and dashpots"),
    *("a parameter", "a parameter and materials", "a parameter and dashpots"),
)


#: Several of these at once, --mixtures.
MIXTURES = (
    *("relaxation and a table", "a parameter and relaxation", "a parameter and a table"),
    *("relaxation, a table and dashpots", "a parameter, relaxation and materials"),
)
#: D with a skew part, --spin: gyroscopic forces from a thousandth of the inertia's to ten times
#: these. K with a skew part: circulatory forces, so too.
SPIN = (
    *("spin", "spin and mass", "spin and stiffness", "spin and structural", "spin and dashpots"),
    *("spin and materials", "spin and relaxation", "spin and a table", "spin and a parameter"),
    *("circulation", "circulation and mass", "circulation and dashpots", "spin and circulation"),
)
#: A range of speeds, --speeds: stiffening and softening, Coriolis forces, moved geometry or none.
SPEEDS = ("speeds and mass", "speeds and stiffness", "speeds and dashpots", "speeds and materials")


@dataclass
class Case:
    """A system, its bands [Hz] and what is asked for."""

    kind: str
    damping: str
    system: System
    bands_hz: list[float]
    tolerance: float
    options: dict[str, Any] = field(default_factory=dict)
    parameter: Any = None  # (T, law)
    speeds: Any = None  # {name: (T, law)} of laws of one speed

    @property
    def varying(self) -> Any:
        """Of the body: a parameter p, or those of the speed."""
        return {"p": self.parameter} if self.parameter else self.speeds or {}

    @property
    def name(self) -> str:
        return "p" if self.parameter else "speed"

    def exactly_at(self, value: float) -> System:
        """The full system with a value of its parameter, as its own term: what the sum with K
        rounds, in long double too, may be more than a claim of soft mounts allows."""
        s = self.system
        if self.speeds:
            known = {name: getattr(s, name) for name in ("alpha", "beta", "eta", "S")}
            terms = [
                (T, law.kind, value, *(() if law.kind == "coriolis" else (law.least, law.power)))
                for T, law in self.speeds.values()
            ]
            return System(s.K, s.M, s.B, s.C, s.D, terms=[*s.terms, *terms], **known)
        T, law = self.parameter
        known = {name: getattr(s, name) for name in ("alpha", "beta", "eta", "S")}
        numbers = (value, law.least, law.slope, law.loss + s.eta, s.beta)
        return System(
            s.K, s.M, s.B, s.C, s.D, terms=[*s.terms, (T, "parameter", *numbers)], **known
        )

    def at(self, value: float) -> System:
        """The same with the sum, of which poles are found faster."""
        s = self.system
        if self.speeds:
            return self._at_speed(value)
        T, law = self.parameter
        stiffer = LONG(law.slope) * (LONG(value) - LONG(law.least)) * np.asarray(T, LONG)
        S = (0.0 if s.S is None else s.S) + law.loss * stiffer
        known = {name: getattr(s, name) for name in ("alpha", "beta", "eta", "terms")}
        return System(s.K + stiffer, s.M, s.B, s.C, s.D, S=S, **known)

    def _at_speed(self, value: float) -> System:
        s = self.system
        K, D = np.asarray(s.K, LONG), 0.0 if s.D is None else np.asarray(s.D, LONG)
        for T, law in self.speeds.values():
            if law.kind == "coriolis":
                D = D + LONG(value) * np.asarray(T, LONG)
            else:
                beyond = LONG(value) ** law.power - LONG(law.least) ** law.power
                K = K + beyond * np.asarray(T, LONG)
        known = {name: getattr(s, name) for name in ("beta", "eta", "S", "terms", "alpha")}
        if s.beta or s.eta:  # of K at the least speed
            D, S = D + LONG(s.beta) * np.asarray(s.K, LONG), LONG(s.eta) * np.asarray(s.K, LONG)
            known |= {"beta": 0.0, "eta": 0.0, "S": S if s.S is None else S + s.S}
        return System(K, s.M, s.B, s.C, D, **known)


def _springs(n: int, pairs: Any, stiffness: Any, ground: Any) -> Any:
    K = np.diag(np.asarray(ground, float))
    for (i, j), k in zip(pairs, stiffness, strict=True):
        K[i, i] += k
        K[j, j] += k
        K[i, j] -= k
        K[j, i] -= k
    return K


def random_case(rng: np.random.Generator, kind: str, damping: str) -> Case:
    """A system of the class, lightly to strongly damped, with a band over some of its modes."""
    many = kind in ("many ports", "many outputs")
    n = int(rng.integers(90, 160)) if many else int(rng.integers(20, 70))
    scale = 10.0 ** rng.uniform(2, 7)
    mass = 10.0 ** rng.uniform(-2, 2)
    chain = [(i, i + 1) for i in range(n - 1)]
    M = mass * np.ones(n)
    if kind in ("modal", "clustered"):
        omega = np.cumsum(rng.exponential(1.0, n)) + 0.5
        if kind == "clustered":
            omega[1::2] = omega[: len(omega[1::2]) * 2 : 2] * (
                1 + 10.0 ** rng.uniform(-9, -3, len(omega[1::2]))
            )
        Q = sl.qr(rng.standard_normal((n, n)))[0]
        K = Q @ np.diag(np.sort(omega) ** 2) @ Q.T * scale
        K = 0.5 * (K + K.T)
    elif kind in ("graph", "printed"):
        pairs = chain + [tuple(rng.choice(n, 2, replace=False)) for _ in range(n)]
        K = _springs(
            n, pairs, scale * 10 ** rng.uniform(-1, 1, len(pairs)), scale * (rng.random(n) < 0.1)
        )
        K[0, 0] += scale
        M = mass * 10 ** rng.uniform(-1, 1, n)
    else:
        ground = np.zeros(n)
        if kind == "soft mounts":
            ground[[0, n - 1]] = scale * 10.0 ** rng.uniform(-9, -4)
        elif kind not in ("free", "elastic part"):
            ground[0] = scale
        K = _springs(n, chain, scale * np.ones(n - 1), ground)
    if kind == "massless":
        M[rng.choice(n, n // 4, replace=False)] = rng.choice([0.0, 1e-15 * mass])
        M[-1] = mass
    p = int(rng.integers(1, 4)) if kind != "many ports" else int(rng.integers(20, 60))
    B = np.zeros((n, p))
    B[rng.choice(n, p, replace=False), range(p)] = 1.0
    if kind in ("chain", "soft mounts", "free", "elastic part"):
        B[:, 0] = 0
        B[-1, 0] = 1
    if kind == "weak ports":
        B[:, 0] = sl.eigh(K, np.diag(M + 1e-12 * mass))[1][:, 0]
        B[:, 0] /= abs(B[:, 0]).max()
        B[-1, 0] += 1e-6
    if kind == "scaled ports":
        B *= 10.0 ** rng.uniform(-6, 6, p)
    C = None
    if kind in ("other outputs", "chain") and rng.random() < 0.7:
        C = np.zeros((int(rng.integers(1, 4)), n))
        C[range(len(C)), rng.choice(n, len(C), replace=False)] = 1.0
        if kind == "chain":
            C[0] = 0
            C[0, 0] = 1
    if kind == "many ports":
        B *= 10.0 ** rng.uniform(-2, 2, p)
        if rng.random() < 0.4:
            C = np.zeros((int(rng.integers(20, 40)), n))
            C[range(len(C)), rng.choice(n, len(C), replace=False)] = 1.0
    if kind == "many outputs":  # or inputs: stresses are differences of neighbours
        C = np.zeros((int(rng.integers(50, 85)), n))
        at = rng.choice(n - 1, len(C), replace=False)
        C[range(len(C)), at] = 1.0
        C[range(len(C)), at + 1] = -1.0
        C *= 10.0 ** rng.uniform(-1, 1, (len(C), 1))
        if rng.random() < 0.3:
            B, C = C.T, B.T
    eigen = sl.eigvalsh(np.diag(M), K + 1e-3 * scale * np.diag(M / mass), subset_by_index=None)
    shift = 1e-3 * scale / mass
    lam = np.sort(1 / eigen[eigen > 1e-9 * eigen.max()] - shift)
    lam = lam[lam > 1e-9 * lam[min(len(lam) - 1, 10)]]
    modes = int(min(rng.integers(3, 14), len(lam) - 3))
    top = (
        np.sqrt(lam[modes] * lam[modes - 1]) ** 0.5
        if rng.random() < 0.5
        else np.sqrt(lam[modes - 1]) * 1.02
    )
    first = np.sqrt(lam[0]) * rng.choice([0.1, 0.5])
    if kind == "soft mounts":
        first = np.sqrt(lam[0]) * 0.2
    if kind == "elastic part":
        first = np.sqrt(lam[0]) * 10.0 ** rng.uniform(-3, 0)
        others = ("dashpots", "general", *MATERIALS, *MIXTURES, *SPIN, *SPEEDS)
        damping = damping if damping not in others else "both"
    zeta = 10.0 ** rng.uniform(-6, -1.5)
    reference = np.sqrt(lam[0] * lam[modes - 1]) ** 0.5
    extra: dict[str, Any] = {}
    D = S = None
    if damping in ("mass", "both", "materials and mass", "spin and mass"):
        extra["alpha"] = 2 * zeta * reference
    if damping in ("stiffness", "both", "spin and stiffness"):
        extra["beta"] = 2 * zeta / top
    if damping in ("structural", "spin and structural"):
        extra["eta"] = 2 * zeta
    if "dashpots" in damping:
        D = np.zeros((n, n))
        for i in rng.choice(n, int(rng.integers(1, 3)), replace=False):
            D[i, i] = zeta * reference * mass * n
    if damping == "general":
        F = rng.standard_normal((n, n)) / np.sqrt(n)
        D = 2 * zeta * reference * mass * (F @ F.T)
        D = 0.5 * (D + D.T)
    speeds = None
    if "speeds" in damping:
        speeds = _speeds(rng, K, M, top)
        options_of_speeds = {"mor_parameter_values": 3}
        if damping == "speeds and mass":
            extra["alpha"] = 2 * zeta * reference
        if damping == "speeds and stiffness":
            extra["beta"] = 2 * zeta / top
    elif "spin" in damping:
        D = (0 if D is None else D) + _gyroscopic(rng, M, top)
    terms: list[Any] = []
    if "circulation" in damping:
        terms.append((top * _gyroscopic(rng, M, top), "circulatory"))
        if damping == "circulation and mass":
            extra["alpha"] = 2 * zeta * reference
    if "materials" in damping:
        S = _losses(rng, K, min(100 * zeta, 1.0))
    if "relaxation" in damping:
        count = int(rng.integers(1, 4))
        g, tau = 10.0 ** rng.uniform(-3, 1, count), 10.0 ** rng.uniform(-2, 2, count) / top
        terms.append((_losses(rng, K, 1.0), "prony", list(g), list(tau)))
    if "table" in damping:
        at = np.sort(rng.uniform(first, top, int(rng.integers(1, 5))))
        values = 10.0 ** rng.uniform(-3, 0.5, (2, len(at) + 2))
        known = [0.9 * first, *at, 1.1 * top]
        terms.append((_losses(rng, K, 1.0), "table", known, *(list(v) for v in values)))
    bands = [first / TWO_PI, top / TWO_PI]
    options: dict[str, Any] = options_of_speeds if speeds else {}
    parameter = None
    if "parameter" in damping:
        if rng.random() < 0.5:
            extra["beta"] = 2 * zeta / top
        extra["eta"] = 2 * zeta
        loss = rng.choice([0.0, 10.0 ** rng.uniform(-3, -0.5)])
        law = flexgram.parameter(1.0, 1 + 10.0 ** rng.uniform(-1, 1), loss=float(loss))
        parameter = (_losses(rng, K, 1.0), law)
        options["mor_parameter_values"] = 3
    if kind == "elastic part":
        options["mor_tol_relative_to"] = "elastic"
    if kind == "two bands":
        a, b = bands
        bands = [a, a + 0.25 * (b - a), a + 0.6 * (b - a), b]
    if kind == "mode on cutoff":
        ratio = np.sqrt(lam[modes + 1]) / top
        if ratio > 1.06:
            options["mor_cutoff"] = ratio * (1 + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-9, -5))
    tolerance = 10.0 ** rng.uniform(-10, -1)
    if kind == "printed":  # the claim is of the rounded matrices
        digits = int(rng.choice([6, 10, 14]))
        K, M = (np.vectorize(lambda x: float(f"{x:.{digits - 1}e}"))(a) for a in (K, M))
    system = System(K, np.diag(M), B, C, D, S=S, terms=terms, **extra)
    return Case(kind, damping, system, bands, tolerance, options, parameter, speeds)


def _speeds(rng: np.random.Generator, K: Any, M: Any, top: float) -> Any:
    """Speeds up to a thirtieth or to twice the band's end: stiffness of stress with either sign,
    M_c of some directions, Coriolis forces between neighbours."""
    n, most = len(M), top * 10.0 ** rng.uniform(-1.5, 0.3)
    least = float(rng.choice([0.0, rng.uniform(0, 0.7) * most]))
    stress = _losses(rng, K, 10.0 ** rng.uniform(-3, 0.3)) / most**2
    if rng.random() < 0.4:  # compressed in part
        stress -= _losses(rng, K, 10.0 ** rng.uniform(-4, -1)) / most**2
    across = M * (rng.random(n) < 0.7)
    turn = np.triu(np.tril(rng.uniform(-2, 2, (n, n)), 1), 1)
    G = np.sqrt(np.outer(M, M)) * 0.5 * (turn - turn.T)
    terms = {
        "spin": (stress - np.diag(across), flexgram.spin(least, most)),
        "coriolis": (G, flexgram.coriolis(least, most)),
    }
    if rng.random() < 0.5:
        moved = _losses(rng, K, 10.0 ** rng.uniform(-3, 0)) / most**4
        terms["moved"] = (moved, flexgram.spin(least, most, power=4))
    return terms


def _gyroscopic(rng: np.random.Generator, M: Any, top: float) -> Any:
    """Skew, between neighbours or all dofs, of dofs with mass alone or of some without."""
    n = len(M)
    G = np.triu(rng.standard_normal((n, n)), 1)
    if rng.random() < 0.5:
        G = np.triu(np.tril(G, 1))
    root = np.sqrt(M if rng.random() < 0.7 else np.maximum(M, 1e-3 * M.max()))
    G = root[:, None] * (G - G.T) * root
    size = np.linalg.norm(G / np.maximum.outer(root, root) ** 2, 2) if root.min() > 0 else n
    return 10.0 ** rng.uniform(-3, 1) * top / size * G


def _losses(rng: np.random.Generator, K: Any, largest: float) -> Any:
    """Rᵀ diag(η) R with RᵀR = K: parts of K with loss factors over three decades."""
    values, vectors = sl.eigh(K)
    R = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T
    turn = sl.qr(rng.standard_normal(K.shape))[0]
    R = turn @ R
    eta = largest * 10.0 ** rng.uniform(-3, 0, len(K))
    S = R.T @ (eta[:, None] * R)
    return 0.5 * (S + S.T)


@dataclass
class Verdict:
    """What became of a case."""

    outcome: str  # certified, certified outside, estimated, not met, refused
    ratio: float = 0.0  # largest true over certified error
    bound: float = 0.0
    sharp: float = 0.0  # certified over attained supremum
    at: float = 0.0
    field: float = 0.0  # largest true over certified error of the field
    words: str = ""
    order: int = 0
    true: float = 0.0  # largest true error
    floor: float = 0.0  # largest rounding part of the claim over the largest true error
    decides: bool = False  # that part is more than half of the claim


def _reduced(rom: flexgram.ReducedModel) -> System:
    """The reduced body for the referee."""
    return System(
        *(rom.K, rom.M, rom.B, rom.C, rom.D),
        eta=rom.eta,
        rigid=int(rom.frame["rigid_modes"]),
        S=rom.system.S if rom.system.S.any() else None,
        terms=[
            (term.matrix, term.law.kind, *(list(x) for x in term.law.numbers().values()))
            for term in rom.system.terms
        ],
    )


def examine(case: Case, rng: np.random.Generator) -> Verdict:
    """Reduce, and let the referee look for an error above the certified one."""
    s = case.system
    matrices = flexgram.Matrices(
        K=sp.csr_matrix(s.K),
        M=sp.csr_matrix(s.M),
        D=None if s.D is None else sp.csr_matrix(s.D),
        S=None if s.S is None else sp.csr_matrix(s.S),
        B=s.B,
        C=None if s.C is s.B.T or np.array_equal(s.C, s.B.T) else s.C,
        alpha=s.alpha,
        beta=s.beta,
        eta=s.eta,
        terms={
            f"term{k}": (sp.csr_matrix(T), getattr(flexgram, law)(*numbers))
            for k, (T, law, *numbers) in enumerate(s.terms)
        }
        | {name: (sp.csr_matrix(T), law) for name, (T, law) in case.varying.items()},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            rom = flexgram.reduce(
                matrices,
                case.bands_hz,
                case.tolerance,
                options={"mor_field_error": "yes", **case.options},
            )
        except BodyError as error:
            return Verdict("refused", words=str(error))
    outcome = rom.kind if rom.met else "not met"
    verdict = Verdict(outcome, bound=rom.certified_error, order=rom.order)
    if rom.kind == "estimated":
        return verdict
    values = judged_values(case, rom, rng) if case.varying else [{}]
    worst, reference = 0.0, rom.relative_to if rom.bounds_elastic_part else "pointwise"
    for chosen in values:
        if chosen:
            s = case.at(chosen[case.name])
        here = rom.at(**chosen)
        reduced, bound = _reduced(here), here.certified_error
        for omega in hard_frequencies(s, reduced, rom.bands, rom.excluded, rng):
            truth = relative_error(s, reduced, omega, reference)
            if truth > bound:  # by the rounding of long double?
                full = case.exactly_at(chosen[case.name]) if chosen else s
                truth = relative_error(full, reduced, omega, reference, exactly=True)
            if truth > worst:
                worst, verdict.at = truth, omega
            if np.isfinite(bound):  # else nothing is claimed
                verdict.ratio = max(verdict.ratio, truth / bound)
    verdict.true = worst
    if not rom.met and worst <= case.tolerance:
        verdict.true = max(worst, error_at_zeros(s, reduced, rom.unmet))
    if worst > 0:
        verdict.floor = rom.floor.max() / worst
        verdict.decides = bool(rom.floor.max() > 0.5 * verdict.bound)
    verdict.sharp = verdict.bound / rom.attained_error
    if np.isfinite(rom.field_error[0]):
        verdict.field = largest_field_error(s, rom, rng) / rom.field_error[0]
    return verdict


def judged_values(case: Case, rom: flexgram.ReducedModel, rng: np.random.Generator) -> Any:
    """Those that the claim is of; if it is of all, also where the error is largest as far as
    doubles show it, and a random one."""
    values = [float(p) for (p,) in rom.claim.parameter_values]
    if len(rom.claim.all_values):
        omega = np.concatenate([rng.uniform(first, last, 60) for first, last in rom.bands])
        law = next(iter(case.varying.values()))[1]
        tried = rng.uniform(law.least, law.most, 24)

        def largest(p: float) -> float:
            here = rom.at(**{case.name: p})
            H, H_r = (s.quickly(omega) for s in (case.at(p), _reduced(here)))
            sizes = [np.linalg.norm(a, axis=(1, 2)) for a in (H - H_r, H)]
            return float((sizes[0] / sizes[1]).max())

        values += [tried[np.argmax([largest(p) for p in tried])], tried[0]]
    return [{case.name: float(p)} for p in values]


def error_at_zeros(s: System, reduced: System, intervals: Any) -> float:
    """The largest relative error at zeros of H on the axis, which lie between doubles: by the
    secant method from both ends of each interval, to forty digits."""
    worst = 0.0
    with mpmath.workdps(50):
        fewer = max(1, int(12 * min(1.0, (60 / len(s.M)) ** 3)))  # the price of an elimination
        for a, b in intervals[:fewer]:
            ends = [mpmath.mpf(float(a)), mpmath.mpf(float(b))]
            H = [complex(s.exactly(w)[0, 0]) for w in ends]
            for _ in range(12):
                if H[1] == H[0]:
                    break
                step = (ends[1] - ends[0]) * mpmath.mpmathify(H[1] / (H[1] - H[0]))
                ends = [ends[1], ends[1] - mpmath.re(step)]
                if not a <= ends[1] <= b:
                    break
                H = [H[1], complex(s.exactly(ends[1])[0, 0])]
                worst = max(worst, relative_error(s, reduced, ends[1], exactly=True))
    return worst


def largest_field_error(s: System, rom: flexgram.ReducedModel, rng: np.random.Generator) -> float:
    """Of the whole field, in the norm of the strain energy."""
    values, vectors = sl.eigh(np.asarray(s.K))
    strain = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T  # to find where to look
    rows = [
        System(s.K, s.M, s.B, strain, None, s.alpha, s.beta, s.eta),
        System(rom.K, rom.M, rom.B, strain @ rom.V, rom.D, eta=rom.eta),
    ]
    full = System(s.K, s.M, s.B, np.eye(len(s.K)), None, s.alpha, s.beta, s.eta)
    V, r = np.array(rom.V), int(rom.frame["rigid_modes"])
    V[:, :r] = V[:, :r].mean(axis=0)  # rigid modes count as exactly rigid
    reduced = System(rom.K, rom.M, rom.B, V, rom.D, eta=rom.eta)
    K = np.asarray(s.K).astype(LONG)

    def error(omega: float, exactly: bool) -> float:
        X, X_r = (a.exactly(omega) if exactly else a.transfer(omega) for a in (full, reduced))
        energy = [float(np.einsum("ij,ij->", x.conj(), K @ x).real) for x in (X - X_r, X)]
        return float(np.sqrt(max(energy[0], 0) / energy[1]))

    worst = 0.0
    for omega in hard_frequencies(*rows, rom.bands, rom.excluded, rng, 300):
        here = error(omega, exactly=False)
        if here > max(rom.field_error[0], worst):  # by the rounding of long double?
            here = error(omega, exactly=True)
        worst = max(worst, here)
    return worst


def what_of(index: int, dampings: Any) -> tuple[str, str]:
    """Class and damping. Systems of many ports take thirty times as long as others: in two of
    three rounds others take their turn."""
    turn, which = divmod(index, len(CLASSES))
    kind = CLASSES[which]
    if kind in ("many ports", "many outputs") and turn % 3:
        kind = CLASSES[(turn // len(dampings)) % 13]
    return kind, dampings[turn % len(dampings)]


def main() -> int:
    """Print the table; exit status 1 if any error exceeds its certificate."""
    words = sys.argv[1:]
    steps = {"--every": 1, "--from": 0}
    for name in steps:
        if name in words:
            at = words.index(name)
            steps[name] = int(words[at + 1])
            del words[at : at + 2]
    words = [word for word in words if not word.startswith("--")]
    chosen = {
        "--materials": MATERIALS,
        "--mixtures": MIXTURES,
        "--spin": SPIN,
        "--speeds": SPEEDS,
    }
    dampings = next((of for word, of in chosen.items() if word in sys.argv), DAMPINGS)
    count = int(words[0]) if words else 200
    seed = int(words[1]) if len(words) > 1 else 1
    table: dict[Any, list[Verdict]] = collections.defaultdict(list)
    broken, start = 0, time.time()
    damped = missed = rightly = 0  # systems with damping, not met, whose true error is above
    chosen_ones = range(steps["--from"], count, steps["--every"])
    for index in chosen_ones:
        rng = np.random.default_rng([seed, index])
        kind, damping = what_of(index, dampings)
        case = random_case(rng, kind, damping)
        verdict = examine(case, rng)
        table[kind].append(verdict)
        table["damping: " + damping].append(verdict)
        if verdict.field > 1 + 1e-6:
            broken += 1
            print(
                f"BROKEN FIELD {index} {kind}, {damping}, tol {case.tolerance:.1e}: "
                f"true/certified {verdict.field:.3g}, m = {verdict.order}",
                flush=True,
            )
        if verdict.ratio > 1:
            broken += 1
            print(
                f"BROKEN {index} {kind}, {damping}, tol {case.tolerance:.1e}: true/certified "
                f"{verdict.ratio:.3g}, certified {verdict.bound:.2e}, at {verdict.at!r} rad/s "
                f"of {case.bands_hz}, m = {verdict.order}",
                flush=True,
            )
        damped += damping != "none"
        if verdict.outcome == "not met" and damping != "none":
            missed += 1
            rightly += verdict.true > case.tolerance
            print(
                f"not met {index} {kind}, {damping}, tol {case.tolerance:.1e}: certified "
                f"{verdict.bound:.2e}, true {verdict.true:.2e}, floor/true "
                f"{verdict.floor:.3g}, m = {verdict.order}",
                flush=True,
            )
        if index % 50 == 49:
            seen = [v for name, some in table.items() if name in CLASSES for v in some]
            print(
                f"{index + 1} of {count}, {time.time() - start:.0f} s: largest true/certified "
                f"{max(v.ratio for v in seen):.4f}, {broken} broken",
                flush=True,
            )
        if verdict.outcome == "refused":
            print(f"refused {index} {kind}, {damping}: {verdict.words}", flush=True)
    print(f"{len(chosen_ones)} systems, seed {seed}, {time.time() - start:.0f} s")
    print(
        f"{'class':22} {'systems':>8} {'certified':>10} {'outside':>8} {'estimated':>10} "
        f"{'not met':>8} {'refused':>8} {'true/bound':>17} {'bound/attained':>15} "
        f"{'field':>7}"
    )
    rows = [
        [
            "class",
            "systems",
            "certified",
            "outside intervals",
            "estimated",
            "not met",
            "refused",
            "largest true / certified",
            "certified / attained, median",
        ]
    ]
    for name, verdicts in table.items():
        number = lambda word: sum(v.outcome == word for v in verdicts)  # noqa: E731, B023
        ratios = [v.ratio for v in verdicts]
        sharp = [v.sharp for v in verdicts if 0 < v.sharp < np.inf]
        print(
            f"{name:22} {len(verdicts):8} {number('certified'):10} "
            f"{number('certified outside'):8} {number('estimated'):10} {number('not met'):8} "
            f"{number('refused'):8} {max(ratios):17.3f} "
            f"{np.median(sharp) if sharp else np.nan:15.3f} "
            f"{max(v.field for v in verdicts):7.3f}"
        )
        outcomes = ("certified", "certified outside", "estimated", "not met", "refused")
        median = np.median(sharp) if sharp else np.nan
        rows.append(
            [
                name,
                str(len(verdicts)),
                *(str(number(word)) for word in outcomes),
                f"{max(ratios):.3f}",
                f"{median:.2f}",
            ]
        )
    print(f"not met: {missed} of {damped} with damping, {rightly} of these rightly")
    deciding = [v.floor for verdicts in table.values() for v in verdicts if v.decides]
    if deciding:  # each is in two rows
        print(
            f"rounding is most of the claim of {len(deciding) // 2}: "
            f"{np.median(deciding):.3g} times the largest true error in the median"
        )
    if len(words) > 2:
        with open(words[2], "w", newline="") as file:
            csv.writer(file).writerows(rows)
    print(f"{broken} broken of {len(chosen_ones)}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
