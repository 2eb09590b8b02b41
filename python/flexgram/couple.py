"""Assemblies of reduced bodies: joints, springs and dampers between interfaces, and what the parts'
claims say of the whole.

With receptances H = blockdiag(H_i) of the parts' ports, S the signed ports that a joint ties and Z
its compliance, the assembly answers by H - H Sᵀ (S H Sᵀ + Z)⁻¹ S H. If the parts err by E, it errs
by exactly Xᵀ E (1 + Q E)⁻¹ X, Q = Sᵀ (S H Sᵀ + Z)⁻¹ S, X = 1 - Q H: a bound follows where the norms
of Q E stay below one (small gain), part by part and kind by kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from flexgram.basics import BodyError, written_aside
from flexgram.histories import ports_of
from flexgram.reduced import ReducedModel
from flexgram.response import frequency_response

Floats = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

GROUND = "ground"
#: What is claimed of ports that are inputs and outputs alike, by the letter of their kind.
COLLOCATED = {"f": "displacement from force", "m": "rotation from moment"}
#: Directions of a joint by the ports that move in them.
PORTS = {"x": "fx", "y": "fy", "z": "fz", "rx": "mx", "ry": "my", "rz": "mz"}


@dataclass
class Joint:
    """A connection of two interfaces, or of one with the ground.

    Attributes
    ----------
    first, second : str
        ``part.interface``; the second may be ``ground``.
    directions : sequence of str
        Out of ``x y z rx ry rz``, in the axes of the assembly; empty: those that both have.
    stiffness, damping : dict
        [N/m], [N m/rad] and [N s/m], [N m s/rad] by direction; both empty: tied.
    """

    first: str
    second: str
    directions: Sequence[str] = ()
    stiffness: Mapping[str, float] = field(default_factory=dict)
    damping: Mapping[str, float] = field(default_factory=dict)

    @property
    def ties(self) -> bool:
        return not self.stiffness and not self.damping


def read_joint(option: str, kind: str, text: str) -> Joint:
    """A joint of the command line: ``a.eye=b.pin``, with ``:x,y`` (kind ``join``) or ``:x=1e6``
    (``spring``, ``damper``)."""
    ends, _, more = text.partition(":")
    first, equals, second = (word.strip() for word in ends.partition("="))
    if not equals or "." not in first or ("." not in second and second != GROUND):
        raise BodyError(f"{option} {text}: expected PART.INTERFACE=PART.INTERFACE, or =ground")
    words = [word.strip() for word in more.split(",") if word.strip()]
    if kind == "join":
        return Joint(first, second, words)
    values = {}
    for word in words:
        direction, _, number = word.partition("=")
        try:
            values[direction] = float(number)
        except ValueError:
            values[direction] = np.nan
        if not values[direction] > 0 or not np.isfinite(values[direction]):
            raise BodyError(f"{option} {text}: {word} must be a direction and a positive number")
    if not values:
        raise BodyError(f"{option} {text}: expected :x=1e6 and so on, by direction")
    if kind == "spring":
        return Joint(first, second, stiffness=values)
    return Joint(first, second, damping=values)


@dataclass
class Verdict:
    """What the parts' claims say of the assembly.

    Attributes
    ----------
    omega : (n,) array
        [rad/s]
    bound : (n,) array
        Of the assembly's error relative to ‖H‖_F; inf where it does not close.
    gain : (n,) array
        Small gain: the bound closes below one.
    """

    omega: Floats
    bound: Floats
    gain: Floats
    proved: bool = True  #: the parts are certified

    @property
    def words(self) -> str:
        closed = np.isfinite(self.bound)
        if not self.proved:
            return "not known: a part is not certified"
        if closed.all():
            return (f"at most {self.bound.max():.1e} at {len(self.omega)} frequencies, by the "
                    "parts' claims (between them not proved)")  # fmt: skip
        worst = self.bound[closed].max() if closed.any() else np.inf
        return (f"the parts' claims bound it at {closed.sum()} of {len(self.omega)} frequencies "
                f"(by {worst:.1e}); at the others their errors may grow in the assembly (gain up "
                f"to {self.gain.max():.1g}): reduce the parts to a smaller tolerance")  # fmt: skip


def _rotation(model: ReducedModel, turn: ArrayLike | None) -> Floats:
    """The matrix from the axes of a part to those of the assembly, of a rotation vector [rad]."""
    if turn is None:
        return np.eye(3)
    vector = np.asarray(turn, dtype=float)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise BodyError(f"turn = {turn!r} must be three finite numbers, a rotation vector")
    across = np.cross(vector, np.eye(3)).T  # x -> v × x
    return np.asarray(scipy.linalg.expm(across), dtype=float)


class _Parts:
    """The parts side by side, and combinations of their ports."""

    def __init__(self, models: Mapping[str, ReducedModel], turns: Mapping[str, ArrayLike]) -> None:
        self.models = dict(models)
        for name in turns:
            if name not in models:
                raise BodyError(f"there is no part {name} to turn; there are {', '.join(models)}")
        self.turn = {name: _rotation(m, turns.get(name)) for name, m in models.items()}
        etas = {m.eta for m in models.values()}
        if len(etas) > 1:
            raise BodyError("the parts have different structural damping (eta): the assembly has "
                            "none of its own; give Rayleigh damping instead")  # fmt: skip
        self.eta = etas.pop()
        blocks = [(m.M, m.D, m.K, m.B, m.C) for m in models.values()]
        self.M, self.D, self.K, self.B, self.C = (
            scipy.linalg.block_diag(*parts) for parts in zip(*blocks, strict=True)
        )
        self.inputs = [f"{n}.{p}" for n, m in models.items() for p in m.inputs]
        self.outputs = [f"{n}.{p}" for n, m in models.items() for p in m.outputs]

    def part_of(self, port: str) -> str:
        for name in sorted(self.models, key=len, reverse=True):
            if port.startswith(name + "."):
                return name
        raise BodyError(f"{port}: there is no such part; there are {', '.join(self.models)}")

    def has(self, interface: str) -> list[str]:
        """Directions in which an interface can be tied."""
        part = self.part_of(interface)
        there = [d for d, f in PORTS.items() if f"{interface}.{f}" in self.inputs
                 and f"{interface}.{f}" in self.outputs]  # fmt: skip
        if not there:
            names = sorted({p.rpartition(".")[0] for p in self.inputs if p in self.outputs})
            raise BodyError(f"{interface} is no interface; there are {', '.join(names)}")
        whole = [d for group in ("x y z", "rx ry rz")
                 for d in group.split() if set(group.split()) <= set(there)]  # fmt: skip
        plain = np.allclose(self.turn[part], np.eye(3))
        return there if plain else whole

    def port(self, interface: str, direction: str) -> Floats:
        """The combination of inputs (and of the same outputs) that moves an interface in a
        direction of the assembly."""
        R = self.turn[self.part_of(interface)]
        axis = np.eye(3)["xyz".index(direction[-1])]
        local = R.T @ axis
        weights = np.zeros(len(self.inputs))
        for share, letter in zip(local, "xyz", strict=True):
            if abs(share) > 1e-15:
                force = PORTS[("r" if direction[0] == "r" else "") + letter]
                weights[self.inputs.index(f"{interface}.{force}")] = share
        return weights


def _tied(parts: _Parts, joint: Joint) -> list[tuple[str, Floats]]:
    """Directions of a joint with the combination of ports that it holds together."""
    first = parts.has(joint.first)
    second = first if joint.second == GROUND else parts.has(joint.second)
    own = set(joint.stiffness) | set(joint.damping)
    wanted = list(joint.directions) or [d for d in PORTS if d in own] or [
        d for d in PORTS if d in first and d in second
    ]  # fmt: skip
    result = []
    for direction in wanted:
        if direction not in PORTS:
            raise BodyError(f"joint {joint.first} = {joint.second}: {direction} must be one of "
                            f"{', '.join(PORTS)}")  # fmt: skip
        for name, there in ((joint.first, first), (joint.second, second)):
            if direction not in there:
                raise BodyError(f"joint {joint.first} = {joint.second}: {name} has no {direction}")
        sign = parts.port(joint.first, direction)
        if joint.second != GROUND:
            sign = sign - parts.port(joint.second, direction)
        result.append((direction, sign))
    return result


def couple(
    models: Mapping[str, ReducedModel],
    joints: Sequence[Joint],
    *,
    turns: Mapping[str, ArrayLike] | None = None,
    keep: Sequence[str] = (),
) -> ReducedModel:
    """One reduced body of several.

    Parameters
    ----------
    models : mapping
        Parts by name.
    joints : sequence of Joint
    turns : mapping, optional
        Rotation vectors [rad] of parts whose axes are not those of the assembly. Parts need not be
        moved: a joint brings two interfaces together.
    keep : sequence of str
        Joined interfaces, ``part.interface``, whose ports stay ports; others that are joined go.

    Returns
    -------
    ReducedModel
        Ports ``part.port``; without a basis. Its error at some frequencies follows from the parts'
        claims (``verdict``), between them it is estimated.

    Raises
    ------
    BodyError
        For joints that hold the same motion twice, that are of no interface, or parts that cannot
        be put together.
    """
    if not models:
        raise BodyError("couple: no parts")
    parts = _Parts(models, turns or {})
    K, D = parts.K.copy(), parts.D.copy()
    rows: list[Floats] = []
    for joint in joints:
        if parts.eta and not joint.ties:
            raise BodyError("springs beside structural damping (eta) would be damped too: give the "
                            "parts Rayleigh damping instead")  # fmt: skip
        for direction, weights in _tied(parts, joint):
            moved = parts.B @ weights  # of q: what the outputs of the same ports measure
            if joint.ties:
                rows.append(moved)
                continue
            K += joint.stiffness.get(direction, 0.0) * np.outer(moved, moved)
            D += joint.damping.get(direction, 0.0) * np.outer(moved, moved)
    N = np.eye(len(parts.M))
    if rows:
        ties = np.array(rows)
        ties = ties / np.linalg.norm(ties, axis=1)[:, None]
        _, values, turned = np.linalg.svd(ties)
        if len(rows) > len(N) or values[-1] < 1e-9 * values[0]:
            raise BodyError("the joints hold a motion twice, or one that the parts' coordinates do "
                            "not have: leave out directions, or reduce the parts with -mor_statics "
                            "yes")  # fmt: skip
        N = turned[len(rows) :].T
    joined = {name for joint in joints for name in (joint.first, joint.second)} - set(keep)
    inputs = [i for i, p in enumerate(parts.inputs) if p.rpartition(".")[0] not in joined]
    outputs = [i for i, p in enumerate(parts.outputs) if p.rpartition(".")[0] not in joined]
    if not inputs or not outputs:
        raise BodyError("every interface is joined and no port is left: keep one (--keep)")
    bands = _common_bands([m.bands for m in models.values()])
    fields: dict[str, Any] = {
        "M": _symmetric(N.T @ parts.M @ N), "D": _symmetric(N.T @ D @ N),
        "K": _symmetric(N.T @ K @ N), "eta": parts.eta,
        "B": N.T @ parts.B[:, inputs], "C": parts.C[outputs] @ N,
        "B/names": [parts.inputs[i] for i in inputs],
        "C/names": [parts.outputs[i] for i in outputs],
        "feedthrough": scipy.linalg.block_diag(
            *(m.feedthrough for m in models.values()))[np.ix_(outputs, inputs)],
        "gramian/sigma": np.empty(0), "error/bands": bands,
        "band": np.array([bands[0, 0], bands[-1, 1]]), "method": "couple",
        "error/kind": "estimated", "frame/kind": "none",
    }  # fmt: skip
    squares = scipy.linalg.eigh(fields["K"], fields["M"], eigvals_only=True)
    fields["modes/omega"] = np.sqrt(np.maximum(squares, 0))
    known = verdict(models, joints, turns=turns, keep=keep, modes=fields["modes/omega"])
    fields |= {"error/omega": known.omega, "error/relative": known.bound,
               "error/worst": float(known.bound.max(initial=0)),
               "error/relative_to": "pointwise",
               "log/plan": [f"parts\t{', '.join(models)}", f"error\t{known.words}"]}  # fmt: skip
    return ReducedModel(fields, lambda path: _write(fields, Path(path)))


def _symmetric(A: Floats) -> Floats:
    return 0.5 * (A + A.T)


def _common_bands(all_bands: Sequence[Floats]) -> Floats:
    """Where every part is claimed to be good."""
    common = [tuple(band) for band in all_bands[0]]
    for bands in all_bands[1:]:
        common = [(max(a, c), min(b, d)) for a, b in common for c, d in bands
                  if max(a, c) <= min(b, d)]  # fmt: skip
    if not common:
        raise BodyError("the parts' bands have no frequency in common")
    return np.array(common)


def _errors(model: ReducedModel, H: ComplexArray, kinds: Sequence[str]) -> Floats:
    """‖E‖ at most, of each block of the ports of two kinds (the outputs', the inputs'), where the
    body answers by H: of each claim the part that is those ports'."""
    E = np.full((len(kinds), len(kinds)), _share(model.whole_error) * float(np.linalg.norm(H)))
    claims = dict(zip(model.kinds, model.by_kind, strict=True)) if len(model.by_kind) else {}
    for k, kind in enumerate(kinds):
        claim = claims.get(COLLOCATED.get(kind, ""))
        if claim is not None:
            output, _, input_ = COLLOCATED[kind].partition(" from ")
            block = np.ix_(ports_of(model.outputs, output), ports_of(model.inputs, input_))
            E[k, k] = min(E[k, k], _share(float(claim)) * float(np.linalg.norm(H[block])))
    return E


def _share(claim: float) -> float:
    """‖E‖ <= ε ‖H‖ in terms of ‖H_r‖."""
    return claim / (1 - claim) if claim < 1 else np.inf


def verdict(
    models: Mapping[str, ReducedModel],
    joints: Sequence[Joint],
    *,
    turns: Mapping[str, ArrayLike] | None = None,
    keep: Sequence[str] = (),
    omega: ArrayLike | None = None,
    modes: Floats | None = None,
) -> Verdict:
    """What the parts' claims say of the assembly's H at some frequencies.

    Parameters
    ----------
    models, joints, turns, keep
        As of ``couple``.
    omega : (n,) array, optional
        [rad/s]; default: those of the parts' curves in the band that they share, and the assembly's
        ``modes`` there.

    Raises
    ------
    BodyError
        For frequencies outside a part's band, and claims that say nothing of single frequencies.
    """
    parts = _Parts(models, turns or {})
    bands = _common_bands([m.bands for m in models.values()])
    if omega is None:
        grid = np.concatenate([*(m.omega for m in models.values()),
                               np.empty(0) if modes is None else modes])  # fmt: skip
        w = np.unique(grid)
        w = w[np.any([(w >= a) & (w <= b) for a, b in bands], axis=0)]
        w = np.unique(np.concatenate([w[:: max(1, len(w) // 400)], bands.ravel()]))
    else:
        w = np.atleast_1d(np.asarray(omega, dtype=float))
        if not np.all(np.any([(w >= a * (1 - 1e-12)) & (w <= b * (1 + 1e-12)) for a, b in bands],
                             axis=0)):  # fmt: skip
            raise BodyError("a frequency is outside the band that the parts share")
    for name, model in models.items():
        if model.relative_to != "pointwise":
            raise BodyError(
                f"part {name}: a claim relative to the {model.relative_to} part of H says too "
                "little: reduce with -mor_tol_relative_to pointwise"
            )
        if model.load_names:
            raise BodyError(f"part {name} was reduced for few loads: of single ports nothing is "
                            "claimed")  # fmt: skip
    loop = _Loop(parts, joints, keep)
    bound, gain = np.full(len(w), np.inf), np.full(len(w), np.inf)
    for k, x in enumerate(w):
        if not any(np.any((x >= m.excluded[:, 0]) & (x <= m.excluded[:, 1]))
                   for m in models.values()):  # fmt: skip
            bound[k], gain[k] = loop.at(x)
    proved = all(model.kind != "estimated" for model in models.values())
    return Verdict(w, bound, gain, proved)


class _Loop:
    """The small gain of an assembly: ports that are inputs and outputs alike, in blocks of one part
    and one kind."""

    def __init__(self, parts: _Parts, joints: Sequence[Joint], keep: Sequence[str]) -> None:
        self.parts = parts
        self.ports = [p for p in parts.inputs if p in parts.outputs]
        rows = [parts.inputs.index(p) for p in self.ports]
        ties = [(d, t[rows], joint) for joint in joints for d, t in _tied(parts, joint)]
        self.S = np.array([t for _, t, _ in ties]).reshape(len(ties), len(self.ports))
        self.ties = [(d, joint) for d, _, joint in ties]
        joined = {name for joint in joints for name in (joint.first, joint.second)} - set(keep)
        free = [k for k, p in enumerate(self.ports) if p.rpartition(".")[0] not in joined]
        self.P = np.eye(len(self.ports))[:, free]
        self.blocks: list[list[int]] = []
        self.kinds: dict[str, list[str]] = {}
        for name in parts.models:
            by_kind: dict[str, list[int]] = {}
            for k, port in enumerate(self.ports):
                if parts.part_of(port) == name:
                    end = port.rpartition(".")[2]
                    by_kind.setdefault(end[0] if end in PORTS.values() else "", []).append(k)
            self.blocks += by_kind.values()
            self.kinds[name] = list(by_kind)

    def _sizes(self, A: ComplexArray) -> Floats:
        return np.array([[np.linalg.norm(A[np.ix_(r, c)], 2) for c in self.blocks]
                         for r in self.blocks])  # fmt: skip

    def at(self, omega: float) -> tuple[float, float]:
        """The bound of the error relative to ‖H‖, and the gain."""
        own, errors = [], []
        for name, m in self.parts.models.items():
            H_i = frequency_response(m.K * (1 + 1j * m.eta), m.D, m.M, m.B, m.C, omega)
            mine = [p.removeprefix(name + ".") for p in self.ports if self.parts.part_of(p) == name]
            own.append(H_i[np.ix_([m.outputs.index(p) for p in mine],
                                  [m.inputs.index(p) for p in mine])])  # fmt: skip
            errors.append(_errors(m, H_i, self.kinds[name]))
        H, E = scipy.linalg.block_diag(*own), scipy.linalg.block_diag(*errors)
        if not np.all(np.isfinite(E)):
            return np.inf, np.inf
        Z = np.zeros((len(self.ties), len(self.ties)), dtype=complex)
        for k, (d, joint) in enumerate(self.ties):
            if not joint.ties:
                Z[k, k] = 1 / (joint.stiffness.get(d, 0.0) + 1j * omega * joint.damping.get(d, 0.0))
        Q: Any = self.S.T @ np.linalg.solve(self.S @ H @ self.S.T + Z, self.S.astype(complex))
        loop = self._sizes(Q) @ E
        gain = float(np.abs(np.linalg.eigvals(loop)).max(initial=0))
        if not gain < 1 or not self.P.shape[1]:
            return np.inf, gain
        X = (np.eye(len(H)) - Q @ H) @ self.P
        answer = np.array([np.linalg.norm(X[r]) for r in self.blocks])
        away = float(answer @ E @ np.linalg.solve(np.eye(len(loop)) - loop, answer))
        left = float(np.linalg.norm(self.P.T @ (H - H @ Q @ H) @ self.P)) - away
        return (away / left if left > 0 else np.inf), gain


def _write(fields: Mapping[str, Any], path: Path) -> None:
    """A reduced file of these fields."""
    with written_aside(path) as place, h5py.File(place, "w") as file:
        for name, value in fields.items():
            if isinstance(value, np.ndarray) and name != "band":
                file[name] = value
        for name, value in fields.items():
            group, _, key = name.rpartition("/")
            if name not in file:
                at = (
                    file.require_group(group) if group and group not in file else file[group or "/"]
                )
                at.attrs[key] = value
