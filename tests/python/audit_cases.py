"""Random systems of the audit: their matrices, damping, bands and tolerances."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg as sl

import flexgram
from referee import LONG, TWO_PI, System

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
#: Terms times a parameter, --products: of a modulus that relaxes, or is in a table; of dampers; of
#: loss factors.
PRODUCTS = (
    *("a product of relaxation", "a product of a table", "a product of relaxation and materials"),
    *("a range of dampers", "a range of loss factors", "a range of dampers and a table"),
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
#: K less a part of it, up to the load at which it buckles, or more a part, --prestressed; stiffness
#: damping is of K without the load.
PRESTRESSED = (
    *("compressed and mass", "compressed and stiffness", "compressed and structural"),
    *("compressed and dashpots", "compressed and materials", "compressed and spin"),
    *("stretched and mass", "stretched and stiffness", "stretched and spin"),
)


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
    products: Any = field(default_factory=dict)  # {name: (T, law)} of laws times a parameter p
    speeds: Any = None  # {name: (T, law)} of laws of one speed

    @property
    def varying(self) -> Any:
        """Of the body: a parameter p, or those of the speed."""
        own = {"p": self.parameter} if self.parameter else {}
        return own | self.products or self.speeds or {}

    @property
    def name(self) -> str:
        return "speed" if self.speeds else "p"

    def _products_at(self, value: float) -> list[Any]:
        return [
            (T, "product", value, law.slope, law.factor.kind, *_numbers(law.factor))
            for T, law in self.products.values()
        ]

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
        terms = self._products_at(value)
        known = {name: getattr(s, name) for name in ("alpha", "beta", "eta", "S")}
        if self.parameter:
            T, law = self.parameter
            numbers = (value, law.least, law.slope, law.loss + s.eta, s.beta)
            terms.append((T, "parameter", *numbers))
        return System(s.K, s.M, s.B, s.C, s.D, terms=[*s.terms, *terms], **known)

    def at(self, value: float) -> System:
        """The same with the sum, of which poles are found faster."""
        s = self.system
        if self.speeds:
            return self._at_speed(value)
        if not self.parameter:
            return self.exactly_at(value)
        T, law = self.parameter
        stiffer = LONG(law.slope) * (LONG(value) - LONG(law.least)) * np.asarray(T, LONG)
        S = (0.0 if s.S is None else s.S) + law.loss * stiffer
        known = {name: getattr(s, name) for name in ("alpha", "beta", "eta")}
        terms = [*s.terms, *self._products_at(value)]
        return System(s.K + stiffer, s.M, s.B, s.C, s.D, S=S, terms=terms, **known)

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


def random_case(rng: np.random.Generator, kind: str, damping: str, is_small: bool = False) -> Case:
    """A system of the class, lightly to strongly damped, with a band over some of its modes.

    A small one has about a third of the dofs and ports.
    """
    many = kind in ("many ports", "many outputs")
    sizes = {False: ((20, 70), (90, 160)), True: ((12, 30), (30, 54))}[is_small][many]
    n, fewer = int(rng.integers(*sizes)), 3 if is_small else 1
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
    unloaded = K
    if "compressed" in damping or "stretched" in damping:
        loaded = _loaded_chain if kind in ("free", "elastic part") else _loaded
        K = loaded(rng, K, "compressed" in damping)
    if kind == "massless":
        M[rng.choice(n, n // 4, replace=False)] = rng.choice([0.0, 1e-15 * mass])
        M[-1] = mass
    p = int(rng.integers(1, 4)) if kind != "many ports" else int(rng.integers(20, 60)) // fewer
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
            C = np.zeros((int(rng.integers(20, 40)) // fewer, n))
            C[range(len(C)), rng.choice(n, len(C), replace=False)] = 1.0
    if kind == "many outputs":  # or inputs: stresses are differences of neighbours
        C = np.zeros((int(rng.integers(50, 85)) // fewer, n))
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
        others = ("dashpots", "general", *MATERIALS, *MIXTURES, *SPIN, *SPEEDS, *PRESTRESSED)
        damping = damping if damping not in others else "both"
    zeta = 10.0 ** rng.uniform(-6, -1.5)
    reference = np.sqrt(lam[0] * lam[modes - 1]) ** 0.5
    extra: dict[str, Any] = {}
    D = S = None
    if damping in ("mass", "both") or damping.endswith("and mass"):
        extra["alpha"] = 2 * zeta * reference
    if damping in ("stiffness", "both", "spin and stiffness"):
        extra["beta"] = 2 * zeta / top
    if damping in PRESTRESSED and "stiffness" in damping:
        D = 2 * zeta / top * unloaded
    if damping in ("structural", "spin and structural", "compressed and structural"):
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
        if damping == "speeds and stiffness":
            extra["beta"] = 2 * zeta / top
    elif "spin" in damping:
        D = (0 if D is None else D) + _gyroscopic(rng, M, top)
    terms: list[Any] = []
    if "circulation" in damping:
        terms.append((top * _gyroscopic(rng, M, top), "circulatory"))
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
    parameter, products = None, {}
    if "range of" in damping:
        extra["alpha"] = 2 * zeta * reference
        least = float(rng.choice([0.0, 1.0]))
        p = flexgram.parameter(least, 1 + 10.0 ** rng.uniform(-1, 1))
        T = _losses(rng, K, min(100 * zeta, 1.0))
        if "dampers" in damping:
            products["p"] = (T / top, flexgram.product(p, flexgram.viscous()))
        else:
            products["p"] = (T, flexgram.product(p, flexgram.loss(1.0)))
        options["mor_parameter_values"] = 3
    if "product" in damping:
        p = flexgram.parameter(1.0, 1 + 10.0 ** rng.uniform(-1, 0.5))
        T, law, *numbers = terms.pop()
        parameter = (T, p)
        products["p:other"] = (T, flexgram.product(p, getattr(flexgram, law)(*numbers)))
        options["mor_parameter_values"] = 3
        extra["eta"] = 2 * zeta
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
    return Case(kind, damping, system, bands, tolerance, options, parameter, products, speeds)


def _numbers(law: Any) -> list[Any]:
    """Of a Prony series or a table, as the referee takes them."""
    own = law.numbers() if law.kind in ("prony", "table") else {}
    return [list(values) for values in own.values()]


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


def _loaded(rng: np.random.Generator, K: Any, is_compressed: bool) -> Any:
    """K and the stiffness of a stress: of one that pulls, up to a thousand times parts of K; of one
    that presses, up to a millionth less than where the softest motion that it loads buckles."""
    stress = _losses(rng, K, 1.0)
    if not is_compressed:
        return K + 10.0 ** rng.uniform(-1, 3) * stress
    values, vectors = sl.eigh(K)
    root = vectors[:, values > 1e-9 * values.max()]
    critical = 1 / sl.eigvalsh(root.T @ stress @ root, root.T @ K @ root).max()
    K = K - critical * (1 - 10.0 ** rng.uniform(-6, 0)) * stress
    return 0.5 * (K + K.T)


def _loaded_chain(rng: np.random.Generator, K: Any, is_compressed: bool) -> Any:
    """So of a free chain, in numbers without rounding: its rigid motion has no stiffness."""
    n, digits = len(K), 2.0**20
    load = 10.0 ** rng.uniform(-6, 0, n - 1) if is_compressed else 10.0 ** rng.uniform(0, 3, n - 1)
    stiffness = np.maximum(1.0, np.round(digits * load)) / digits
    unit = 2.0 ** np.round(np.log2(K.max()))
    return _springs(n, [(i, i + 1) for i in range(n - 1)], unit * stiffness, np.zeros(n))


def _losses(rng: np.random.Generator, K: Any, largest: float) -> Any:
    """Rᵀ diag(η) R with RᵀR = K: parts of K with loss factors over three decades."""
    values, vectors = sl.eigh(K)
    R = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T
    turn = sl.qr(rng.standard_normal(K.shape))[0]
    R = turn @ R
    eta = largest * 10.0 ** rng.uniform(-3, 0, len(K))
    S = R.T @ (eta[:, None] * R)
    return 0.5 * (S + S.T)


def what_of(index: int, dampings: Any) -> tuple[str, str]:
    """Class and damping. Systems of many ports take thirty times as long as others: in two of
    three rounds others take their turn."""
    turn, which = divmod(index, len(CLASSES))
    kind = CLASSES[which]
    if kind in ("many ports", "many outputs") and turn % 3:
        kind = CLASSES[(turn // len(dampings)) % 13]
    return kind, dampings[turn % len(dampings)]
