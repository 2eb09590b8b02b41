"""What the claims of parts say of their assembly.

With receptances H = blockdiag(H_i) of the parts, signed inputs S and outputs S' of what a joint
ties and its compliance Z, the assembly answers by H - H Q H, Q = Sᵀ (S' H Sᵀ + Z)⁻¹ S'. If the
parts err by E, it errs by exactly (1 - H Q) E (1 + Q E)⁻¹ (1 - Q H): a bound follows where the
norms of Q E stay below one (small gain), part by part and kind by kind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from flexgram.assembly.interval_series import Chosen, OutputTerms
from flexgram.assembly.joints import Joint, Parts, tied
from flexgram.basics import ComplexArray, Floats
from flexgram.model.elastic_part import without_rigid_modes
from flexgram.model.kinds import CROSSED, INPUT_KINDS, OUTPUT_KINDS, ports_of
from flexgram.model.reduced import ReducedBody

#: Norms of a block of rows and columns.
Sizes = Callable[[Chosen, Chosen], Floats]
#: Up to so many rows or columns spectral norms are worth their price.
FEW = 12
#: Kinds of H below this share of what their ports answer to themselves are left without a claim.
ZERO = 1e-9


@dataclass
class View:
    """A block of the assembly's H: all of it, or what one kind of outputs has of one of inputs."""

    name: str
    rows: list[int]  #: among the outputs that are left
    columns: list[int]  #: among the inputs that are left


def errors_of(
    model: ReducedBody,
    outputs: Sequence[str],
    inputs: Sequence[str],
    size: Callable[[Chosen, Chosen], Floats],
    own: Callable[[Chosen, Chosen], Floats],
) -> Floats:
    """‖E‖_F at most, of each block of a kind of outputs from a kind of inputs.

    Parameters
    ----------
    outputs, inputs : sequences of str
        Kinds.
    size, own : callables
        Of rows and columns: ‖H_r‖_F of their block, and the same of the roots of what each row
        answers to itself times what each column does.

    Returns
    -------
    (outputs, inputs, …) array
    """
    whole = _share(model.claim.whole) * size(slice(None), slice(None))
    E = np.array([[whole] * len(inputs)] * len(outputs))
    if not len(model.claim.by_kind):
        return E
    claims = dict(zip(model.claim.kinds, model.claim.by_kind, strict=True))
    least = dict(zip(model.claim.kinds, model.claim.kind_least, strict=True))
    for i, output in enumerate(outputs):
        for j, input_ in enumerate(inputs):
            kind = f"{output} from {input_}"
            if kind in claims:
                share = _share(float(claims[kind]))
            elif not output or not input_ or model.claim.is_hidden(output, input_):
                continue
            else:
                share = 1.0
            if share < np.inf:
                ports = ports_of(model.outputs, output), ports_of(model.inputs, input_)
                error = share * np.maximum(size(*ports), least.get(kind, 0.0))
                if kind not in claims:  # nothing but rounding, which `reduce` judges by this
                    error = error + ZERO * own(*ports)
                E[i, j] = np.minimum(E[i, j], error)
    return E


def growth_of(Q: Floats, E: Floats) -> tuple[Floats, Floats]:
    """The norms of E (1 + Q E)⁻¹, block by block, from those of Q and E at most, inf where the gain
    is not below one, and the gain; of stacks (…, inputs, outputs) and (…, outputs, inputs)."""
    loop = Q @ np.where(np.isfinite(E), E, 0)
    known = np.isfinite(E).all(axis=(-2, -1)) & np.isfinite(loop).all(axis=(-2, -1))
    loop = np.where(known[..., None, None], loop, 0)
    gain = np.where(known, np.abs(np.linalg.eigvals(loop)).max(axis=-1, initial=0), np.inf)
    closed = gain < 1
    series = np.linalg.inv(np.eye(loop.shape[-1]) - np.where(closed[..., None, None], loop, 0))
    # Of a gain below one, but for rounding, it is the sum of powers, none of them negative.
    closed &= (np.isfinite(series) & (series >= 0)).all(axis=(-2, -1))
    growth = np.where(np.isfinite(E), E, 0) @ series
    return np.where(closed[..., None, None], growth, np.inf), gain


def relative(error: Floats, H: Floats) -> Floats:
    """Errors relative to ‖H‖, which is H at least before them."""
    small = error < H
    return np.divide(
        error, np.where(small, H - error, 1), where=small, out=np.full(H.shape, np.inf)
    )


def size_of(A: ComplexArray) -> float:
    """The spectral norm of few rows or columns, of more ‖A‖_F: no less."""
    return float(np.linalg.norm(A, 2 if min(A.shape) <= FEW else "fro")) if A.size else 0.0


def _norms_of(H: ComplexArray) -> Sizes:
    return lambda rows, columns: np.asarray(np.linalg.norm(H[rows][:, columns]))


def _own_of(m: ReducedBody, omega: float) -> Sizes:
    def answer(x: Floats, ports: Chosen) -> float:
        H = x.T @ np.linalg.solve(m.system.dynamic_stiffness(omega), x)
        return float(np.abs(np.diag(H))[ports].sum())

    return lambda rows, columns: np.asarray(
        np.sqrt(answer(m.system.C.T, rows) * answer(m.system.B, columns))
    )


def _share(claim: float) -> float:
    """‖E‖ <= ε ‖H‖ in terms of ‖H_r‖."""
    return claim / (1 - claim) if claim < 1 else np.inf


def _by_kind(names: list[str], kinds: Sequence[str]) -> dict[str, list[int]]:
    """Ports by their kinds, those of none under an empty word."""
    found = {kind: ports_of(names, kind).tolist() for kind in kinds}
    rest = sorted(set(range(len(names))) - {k for ports in found.values() for k in ports})
    return {kind: ports for kind, ports in {**found, "": rest}.items() if ports}


def _views(outputs: list[str], inputs: list[str]) -> list[View]:
    """All of H first, then each kind of outputs from each of inputs."""
    views = [View("all", list(range(len(outputs))), list(range(len(inputs))))]
    rows, columns = _by_kind(outputs, OUTPUT_KINDS), _by_kind(inputs, INPUT_KINDS)
    square = set(rows) == {"displacement", "rotation"} and set(columns) == {"force", "moment"}
    views += [
        View(f"{output} from {input_}", rows[output], columns[input_])
        for output in rows
        for input_ in columns
        if output and input_ and not (square and (output, input_) in CROSSED)
    ]
    return views if len(views) > 2 else views[:1]


def reference_of(model: ReducedBody, whole: Sizes, elastic: Sizes) -> Sizes:
    """What the claim of a free part is relative to, from the norms of blocks (rows, columns) of H
    and of its elastic part. The claim says of the rigid part only that doubles hold it."""
    smallest = max(min([model.claim.whole, *model.claim.by_kind]), 1e-12)
    rigid = 16 * np.finfo(float).eps / smallest

    def size(rows: Chosen, columns: Chosen) -> Floats:
        all_of_it = whole(rows, columns)
        bent = elastic(rows, columns) + rigid * all_of_it
        return np.minimum(bent, all_of_it) if model.claim.relative_to == "both" else bent

    return size


class Loop:
    """The small gain of an assembly, in blocks of one part and one kind of ports."""

    def __init__(self, parts: Parts, joints: Sequence[Joint], keep: Sequence[str]) -> None:
        self.parts = parts
        self.elastic = {
            name: without_rigid_modes(m)
            for name, m in parts.models.items()
            if m.claim.bounds_elastic_part and m.frame.rigid_modes
        }
        found = [(d, weights, joint) for joint in joints for d, weights in tied(parts, joint)]
        self.ties = [(d, joint) for d, _, joint in found]
        shape = len(found), len(parts.inputs)
        self.S_in = np.array([weights for _, weights, _ in found]).reshape(shape)
        self.S_out = np.zeros((len(found), len(parts.outputs)))
        for j in np.flatnonzero(self.S_in.any(axis=0)):
            self.S_out[:, parts.outputs.index(parts.inputs[j])] = self.S_in[:, j]
        joined = {name for joint in joints for name in (joint.first, joint.second)} - set(keep)

        def free(names: list[str]) -> list[int]:
            return [k for k, name in enumerate(names) if name.rpartition(".")[0] not in joined]

        self.free_in, self.free_out = free(parts.inputs), free(parts.outputs)
        self.outputs = OutputTerms.of(m.system for m in parts.models.values()).part(
            self.free_out, self.free_in
        )
        self.views = _views(
            [parts.outputs[k] for k in self.free_out], [parts.inputs[k] for k in self.free_in]
        )
        self.kinds: dict[str, tuple[list[str], list[str]]] = {}  # of outputs, of inputs
        self.in_blocks: list[list[int]] = []
        self.out_blocks: list[list[int]] = []
        first_in = first_out = 0
        for name, m in parts.models.items():
            outputs, inputs = _by_kind(m.outputs, OUTPUT_KINDS), _by_kind(m.inputs, INPUT_KINDS)
            self.kinds[name] = list(outputs), list(inputs)
            self.out_blocks += [[first_out + k for k in ports] for ports in outputs.values()]
            self.in_blocks += [[first_in + k for k in ports] for ports in inputs.values()]
            first_in, first_out = first_in + len(m.inputs), first_out + len(m.outputs)

    def at(self, omega: float) -> tuple[Floats, float]:
        """Bounds of the error relative to ‖H‖ of each of the views, and the gain."""
        own, errors = [], []
        for name, m in self.parts.models.items():
            own.append(m.system.receptance(omega))
            sizes, e = _norms_of(m.system.claimed(omega)), self.elastic.get(name)
            if e is not None:
                sizes = reference_of(m, sizes, _norms_of(e.system.claimed(omega)))
            errors.append(errors_of(m, *self.kinds[name], sizes, _own_of(m, omega)))
        H, E = scipy.linalg.block_diag(*own), scipy.linalg.block_diag(*errors)
        # Forces λ of the joints: motion apart G λ = S u where tied, λ = Y (S u - G λ) of springs.
        G, right = self.S_out @ H @ self.S_in.T, self.S_out.astype(complex)
        for k, (d, joint) in enumerate(self.ties):
            if not joint.ties:
                Y = joint.complex_stiffness(d) + 1j * omega * joint.damper(d)
                G[k], right[k] = Y * G[k], Y * right[k]
                G[k, k] += 1
        Q = np.asarray(self.S_in.T @ np.linalg.solve(G, right), dtype=np.complex128)
        after = np.eye(len(H), dtype=complex)[self.free_out] - H[self.free_out] @ Q
        before = np.eye(H.shape[1], dtype=complex)[:, self.free_in] - Q @ H[:, self.free_in]
        whole = self.outputs.at(after @ H[:, self.free_in], omega)
        larger = self.outputs.largest(omega)
        of_Q = np.array(
            [[size_of(Q[np.ix_(r, c)]) for c in self.out_blocks] for r in self.in_blocks]
        )
        growth, gain = growth_of(of_Q, E)
        bounds = np.full(len(self.views), np.inf)
        if np.isfinite(growth).all():
            for k, view in enumerate(self.views):
                behind = np.array([size_of(after[np.ix_(view.rows, c)]) for c in self.out_blocks])
                ahead = np.array([size_of(before[np.ix_(r, view.columns)]) for r in self.in_blocks])
                H_view = np.linalg.norm(whole[np.ix_(view.rows, view.columns)])
                error = larger[view.rows].max(initial=1) * (behind @ growth @ ahead)
                bounds[k] = relative(np.asarray(error), np.asarray(H_view))
        return bounds, float(gain)
