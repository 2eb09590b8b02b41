"""What the claims of parts say of their assembly.

With receptances H = blockdiag(H_i) of the parts' ports, S the signed ports that a joint ties and Z
its compliance, the assembly answers by H - H Sᵀ (S H Sᵀ + Z)⁻¹ S H. If the parts err by E, it errs
by exactly Xᵀ E (1 + Q E)⁻¹ X, Q = Sᵀ (S H Sᵀ + Z)⁻¹ S, X = 1 - Q H: a bound follows where the norms
of Q E stay below one (small gain), part by part and kind by kind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexgram.histories import ports_of
from flexgram.joints import PORTS, Joint, Parts, tied
from flexgram.reduced import ReducedModel
from flexgram.response import frequency_response

Floats = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
#: Rows or columns of a matrix.
Chosen = Sequence[int] | NDArray[np.int64] | slice

#: Kinds of ports that are inputs and outputs alike, by the letter of their names.
MOTIONS = {"f": "displacement", "m": "rotation"}
FORCES = {"f": "force", "m": "moment"}


def errors_of(
    model: ReducedModel,
    kinds: Sequence[str],
    size: Callable[[Chosen, Chosen], Floats],
) -> Floats:
    """‖E‖_F at most, of each block of the ports of two kinds (the outputs', the inputs'), by the
    sizes of blocks of H: of each claim the part that is those ports'. (kinds, kinds, …)"""
    whole = _share(model.whole_error) * size(slice(None), slice(None))
    E = np.array([[whole] * len(kinds)] * len(kinds))
    claims = dict(zip(model.kinds, model.by_kind, strict=True)) if len(model.by_kind) else {}
    for i, one in enumerate(kinds):
        for j, other in enumerate(kinds):
            output, input_ = MOTIONS.get(one, ""), FORCES.get(other, "")
            claim = claims.get(f"{output} from {input_}")
            if claim is not None:
                block = size(ports_of(model.outputs, output), ports_of(model.inputs, input_))
                E[i, j] = np.minimum(E[i, j], _share(float(claim)) * block)
    return E


def _norms_of(H: ComplexArray) -> Callable[[Chosen, Chosen], Floats]:
    return lambda rows, columns: np.asarray(np.linalg.norm(H[rows][:, columns]))


def bound_of(
    Q: Floats, E: Floats, left: Floats, right: Floats, H: float, rounding: float = 0.0
) -> tuple[float, float]:
    """The bound of the assembly's error relative to ‖H‖_F, and the gain, from norms of blocks: of
    Q, E, 1 - H Q and 1 - Q H at most, of H at least; and the error that rounding adds."""
    loop = Q @ E
    if not np.all(np.isfinite(loop)):
        return np.inf, np.inf
    gain = float(np.abs(np.linalg.eigvals(loop)).max(initial=0))
    if not gain < 1:
        return np.inf, gain
    away = float(left @ E @ np.linalg.solve(np.eye(len(loop)) - loop, right)) + rounding
    return (away / (H - away) if H > away else np.inf), gain


def _share(claim: float) -> float:
    """‖E‖ <= ε ‖H‖ in terms of ‖H_r‖."""
    return claim / (1 - claim) if claim < 1 else np.inf


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
            errors.append(errors_of(m, self.kinds[name], _norms_of(H_i)))
        H, E = scipy.linalg.block_diag(*own), scipy.linalg.block_diag(*errors)
        # Forces λ of the joints: motion apart G λ = S u where tied, λ = Y (S u - G λ) of springs.
        G, right = self.S @ H @ self.S.T, self.S.astype(complex)
        for k, (d, joint) in enumerate(self.ties):
            if not joint.ties:
                Y = joint.stiffness.get(d, 0.0) + 1j * omega * joint.damping.get(d, 0.0)
                G[k], right[k] = Y * G[k], Y * right[k]
                G[k, k] += 1
        Q: Any = self.S.T @ np.linalg.solve(G, right)
        X, Y = (np.eye(len(H)) - Q @ H) @ self.P, self.P.T @ (np.eye(len(H)) - H @ Q)
        return bound_of(
            np.array([[np.linalg.norm(Q[np.ix_(r, c)], 2) for c in self.blocks]
                      for r in self.blocks]), E,
            np.array([np.linalg.norm(Y[:, c], 2) for c in self.blocks]),
            np.array([np.linalg.norm(X[r], 2) for r in self.blocks]),
            float(np.linalg.norm(self.P.T @ (H - H @ Q @ H) @ self.P)))  # fmt: skip
