"""What the claims of parts say of their assembly.

With receptances H = blockdiag(H_i) of the parts' ports, S the signed ports that a joint ties and Z
its compliance, the assembly answers by H - H Sᵀ (S H Sᵀ + Z)⁻¹ S H. If the parts err by E, it errs
by exactly Xᵀ E (1 + Q E)⁻¹ X, Q = Sᵀ (S H Sᵀ + Z)⁻¹ S, X = 1 - Q H: a bound follows where the norms
of Q E stay below one (small gain), part by part and kind by kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from flexgram.basics import BodyError
from flexgram.histories import ports_of
from flexgram.joints import PORTS, Joint, Parts, common_bands, tied
from flexgram.reduced import ReducedModel
from flexgram.response import frequency_response

Floats = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Kinds of ports that are inputs and outputs alike, by the letter of their names.
MOTIONS = {"f": "displacement", "m": "rotation"}
FORCES = {"f": "force", "m": "moment"}


@dataclass
class Verdict:
    """What the parts' claims say of the assembly.

    Attributes
    ----------
    omega : (n,) array
        [rad/s]
    bound : (n,) array
        Of the assembly's error relative to ‖H‖_F, of the ports that are inputs and outputs alike;
        inf where it does not close.
    gain : (n,) array
        Small gain: the bound closes below one; inf where nothing is known of a part.
    unknown : str
        Why the claims of the parts say nothing; empty: they do.
    """

    omega: Floats
    bound: Floats
    gain: Floats
    unknown: str = ""

    @property
    def words(self) -> str:
        closed = np.isfinite(self.bound)
        if self.unknown:
            return f"not known: {self.unknown}"
        if closed.all():
            return (
                f"at most {self.bound.max():.1e} at {len(self.omega)} frequencies, by the parts' "
                "claims, of what is input and output alike (between them not proved)"
            )
        worst = self.bound[closed].max() if closed.any() else np.inf
        return (f"the parts' claims bound it at {closed.sum()} of {len(self.omega)} frequencies "
                f"(by {worst:.1e}); at the others their errors may grow in the assembly (gain up "
                f"to {self.gain.max():.1g}): reduce the parts to a smaller tolerance, free ones by "
                "-mor_tol_relative_to elastic")  # fmt: skip


def _errors(model: ReducedModel, H: ComplexArray, kinds: Sequence[str]) -> Floats:
    """‖E‖ at most, of each block of the ports of two kinds (the outputs', the inputs'), where the
    body answers by H: of each claim the part that is those ports'."""
    E = np.full((len(kinds), len(kinds)), _share(model.whole_error) * float(np.linalg.norm(H)))
    claims = dict(zip(model.kinds, model.by_kind, strict=True)) if len(model.by_kind) else {}
    for i, one in enumerate(kinds):
        for j, other in enumerate(kinds):
            output, input_ = MOTIONS.get(one, ""), FORCES.get(other, "")
            claim = claims.get(f"{output} from {input_}")
            if claim is not None:
                block = np.ix_(ports_of(model.outputs, output), ports_of(model.inputs, input_))
                E[i, j] = min(E[i, j], _share(float(claim)) * float(np.linalg.norm(H[block])))
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
        For frequencies outside a part's band.
    """
    parts = Parts(models, turns or {})
    bands = common_bands([m.bands for m in models.values()])
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
    loop = Loop(parts, joints, keep)
    bound, gain = np.full(len(w), np.inf), np.full(len(w), np.inf)
    unknown = "; ".join(why for name, model in models.items() if (why := _silent(name, model)))
    if unknown:
        return Verdict(w, bound, gain, unknown)
    for k, x in enumerate(w):
        if not any(np.any((x >= m.excluded[:, 0]) & (x <= m.excluded[:, 1]))
                   for m in models.values()):  # fmt: skip
            bound[k], gain[k] = loop.at(x)
    return Verdict(w, bound, gain)


def _silent(name: str, model: ReducedModel) -> str:
    """Why the claim of a part says nothing of its H at a frequency; empty: it does."""
    if model.kind == "estimated":
        return f"part {name} is not certified"
    if model.relative_to == "band":
        return (f"the claim of part {name} is relative to the largest H of the band and says too "
                "little of each frequency (-mor_tol_relative_to pointwise or elastic)")  # fmt: skip
    if model.load_names:
        return f"part {name} was reduced for few loads, of single ports nothing is claimed"
    return ""


class Loop:
    """The small gain of an assembly: ports that are inputs and outputs alike, in blocks of one part
    and one kind."""

    def __init__(self, parts: Parts, joints: Sequence[Joint], keep: Sequence[str]) -> None:
        self.parts = parts
        self.elastic = {name: m.elastic() for name, m in parts.models.items()
                        if m.relative_to == "elastic" and m.frame["rigid_modes"]}  # fmt: skip
        self.ports = [p for p in parts.inputs if p in parts.outputs]
        rows = [parts.inputs.index(p) for p in self.ports]
        ties = [(d, t[rows], joint) for joint in joints for d, t in tied(parts, joint)]
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
            e = self.elastic.get(name)
            if e is not None:  # what the claim is relative to
                H_i = frequency_response(e.K * (1 + 1j * e.eta), e.D, e.M, e.B, e.C, omega)
            errors.append(_errors(m, H_i, self.kinds[name]))
        H, E = scipy.linalg.block_diag(*own), scipy.linalg.block_diag(*errors)
        if not np.all(np.isfinite(E)):
            return np.inf, np.inf
        # Forces λ of the joints: motion apart G λ = S u where tied, λ = Y (S u - G λ) of springs.
        G, right = self.S @ H @ self.S.T, self.S.astype(complex)
        for k, (d, joint) in enumerate(self.ties):
            if not joint.ties:
                Y = joint.stiffness.get(d, 0.0) + 1j * omega * joint.damping.get(d, 0.0)
                G[k], right[k] = Y * G[k], Y * right[k]
                G[k, k] += 1
        Q: Any = self.S.T @ np.linalg.solve(G, right)
        loop = self._sizes(Q) @ E
        gain = float(np.abs(np.linalg.eigvals(loop)).max(initial=0))
        if not gain < 1 or not self.P.shape[1]:
            return np.inf, gain
        X = (np.eye(len(H)) - Q @ H) @ self.P
        answer = np.array([np.linalg.norm(X[r]) for r in self.blocks])
        away = float(answer @ E @ np.linalg.solve(np.eye(len(loop)) - loop, answer))
        left = float(np.linalg.norm(self.P.T @ (H - H @ Q @ H) @ self.P)) - away
        return (away / left if left > 0 else np.inf), gain
