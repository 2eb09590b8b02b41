"""Assemblies of reduced bodies: joints, springs and dampers between interfaces, and what the parts'
claims say of the whole (``assembly_claim``).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from flexgram.assembly.claim import AssemblyBound, verdict
from flexgram.assembly.joints import GROUND, PORTS, Joint, Parts, common_bands, tied
from flexgram.assembly.varying import combinations, parameters_of, with_values
from flexgram.basics import BodyError, Floats, ReductionWarning, written_aside
from flexgram.body.terms import Term
from flexgram.body.varying_laws import Parameter, parameter
from flexgram.model.damped_modes import NaturalModes
from flexgram.model.modes import natural_modes
from flexgram.model.reduced import ReducedBody
from flexgram.reduced_model import ReducedModel

__all__ = ["GROUND", "PORTS", "AssemblyBound", "Joint", "couple", "read_joint", "verdict"]


def read_joint(option: str, kind: str, text: str) -> Joint:
    """A joint of the command line: ``a.eye=b.pin``, with ``:x,y`` (kind ``join``) or ``:x=1e6``
    (``spring``, ``damper``; of springs ``loss=0.1`` too; ``x=1e6..3e6`` is a parameter)."""
    ends, _, more = text.partition(":")
    first, equals, second = (word.strip() for word in ends.partition("="))
    if not equals or "." not in first or ("." not in second and second != GROUND):
        raise BodyError(f"{option} {text}: expected PART.INTERFACE=PART.INTERFACE, or =ground")
    words = [word.strip() for word in more.split(",") if word.strip()]
    if kind == "join":
        return Joint(first, second, words)
    values: dict[str, list[float]] = {}
    for word in words:
        direction, _, numbers = word.partition("=")
        if direction in values:
            raise BodyError(f"{option} {text}: {direction} is given twice")
        try:
            values[direction] = [float(number) for number in numbers.split("..")]
        except ValueError:
            values[direction] = [np.nan]
        if not all(0 < number < np.inf for number in values[direction]):
            raise BodyError(f"{option} {text}: {word} must be a direction and a positive number")
        varies = direction != "loss"
        if (
            len(values[direction]) > 1 + varies
            or sorted(set(values[direction])) != values[direction]
        ):
            raise BodyError(
                f"{option} {text}: {word} must be one number"
                + (", or two that rise, x=1e6..3e6" if varies else "")
            )
    loss = values.pop("loss", [0.0])[0] if kind == "spring" else 0.0
    if not values:
        raise BodyError(f"{option} {text}: expected :x=1e6 and so on, by direction")
    by_direction = {
        direction: parameter(*ends) if len(ends) > 1 else ends[0]
        for direction, ends in values.items()
    }
    if kind == "spring":
        return Joint(first, second, stiffness=by_direction, loss=loss)
    return Joint(first, second, damping=by_direction)


def couple(
    models: Mapping[str, ReducedBody],
    joints: Sequence[Joint],
    *,
    turns: Mapping[str, ArrayLike] | None = None,
    keep: Sequence[str] = (),
    tell: Callable[[str], None] | None = None,
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
    tell : callable, optional
        Called every few seconds with how far the claim is.

    Returns
    -------
    ReducedModel
        Ports ``part.port``; without a basis. Certified if the parts are, and if their claims close
        everywhere in the band (``verdict``).

    Raises
    ------
    BodyError
        For joints that hold the same motion twice, that are of no interface, or parts that cannot
        be put together.

    Examples
    --------
    >>> from flexgram.assembly.joints import Joint
    >>> rack = flexgram.ReducedModel.load("rack.rom.h5")
    >>> tower = couple({"a": rack, "b": rack}, [Joint("a.upper", "b.lower")])
    >>> tower.order == 2 * rack.order - 6, tower.inputs[0]
    (True, 'a.lower.fx')
    """
    if not models:
        raise BodyError("couple: no parts")
    for name, model in models.items():
        model.system.expect_symmetric(f"couple: part {name}: an assembly")
    varying = parameters_of(models, joints)
    parts = Parts(models, turns or {}, joints)
    held = [Held(joint, d, weights) for joint in joints for d, weights in tied(parts, joint)]
    K, D, S, terms = _joined(parts, held)
    N = _motions_left([parts.B @ one.weights for one in held if one.joint.ties], len(K))
    _expect_moving(parts, held, N)
    inputs, outputs = _ports_left(parts, joints, keep)
    direct = _feedthrough(models, parts, joints, inputs, outputs)
    bands = common_bands([m.claim.bands for m in models.values()])
    fields: dict[str, Any] = {
        "M": _symmetric(N.T @ parts.M @ N),
        "D": _symmetric(N.T @ D @ N),
        "K": _symmetric(N.T @ K @ N),
        "eta": parts.eta,
        "B": N.T @ parts.B[:, inputs],
        "C": parts.C[outputs] @ N,
        "B/names": [parts.inputs[i] for i in inputs],
        "C/names": [parts.outputs[i] for i in outputs],
        "feedthrough": direct,
        "output_beta": np.concatenate([m.system.output_beta for m in models.values()])[outputs],
        "output_eta": np.concatenate([m.system.output_eta for m in models.values()])[outputs],
        "gramian/sigma": np.empty(0),
        "error/bands": bands,
        "band": np.array([bands[0, 0], bands[-1, 1]]),
        "method": "couple",
        "frame/kind": "none",
    }
    fields["assembly/parts"] = list(models)
    fields["assembly/joins"] = [f"{joint.first}={joint.second}" for joint in joints]
    ends = np.cumsum([model.order for model in models.values()])[:-1]
    for (name, model), rows in zip(models.items(), np.split(N, ends), strict=True):
        fields[f"parts/{name}"] = rows
        fields[f"parts/{name}/rom"] = str(model.path.resolve()) if model.path else ""
        fields[f"parts/{name}/turn"] = np.asarray((turns or {}).get(name, np.zeros(3)), float)
    if S.any():
        fields["S"] = _symmetric(N.T @ S @ N)
    K_now = fields["K"].copy()
    for term in terms:
        path = f"terms/{term.name}"
        fields[path] = _symmetric(N.T @ term.matrix @ N)
        fields[f"{path}/law"] = term.law.kind
        fields |= {f"{path}/{key}": numbers for key, numbers in term.law.numbers().items()}
        if isinstance(term.law, Parameter):
            K_now += term.law.stiffness * fields[path]
    squares, modes = natural_modes(K_now, fields["M"])
    fields["modes/omega"] = np.sqrt(np.maximum(squares[np.isfinite(squares)], 0))
    fields["frame/rigid_modes"] = rigid = _rigid_motions(parts, held)
    fields["modes/omega"][: fields["frame/rigid_modes"]] = 0  # but for rounding
    values = combinations(models, joints)
    known = AssemblyBound.with_each(
        [
            verdict(
                *with_values(models, joints, dict(zip(varying, row, strict=True))),
                turns=turns,
                keep=keep,
                modes=fields["modes/omega"],
                curve=k == 0,
                tell=tell,
            )
            for k, row in enumerate(values)
        ]
    )
    fields |= _claim(known)
    fields["log/plan"] = [f"parts\t{', '.join(models)}", f"error\t{known.words}"]
    if free := fields["frame/rigid_modes"]:
        fields["log/plan"].append(
            f"free\t{free} rigid motions are left, and errors are relative to |H| with these. If "
            "joints will hold it, join it to ground here: the claim is then of what is held"
        )
    largest = max(model.claim.supremum for model in models.values())
    top = slice(rigid, np.count_nonzero(fields["modes/omega"] <= 2 * fields["band"][1]))
    joint, lost = _lost_by_springs(parts, held, N @ modes[:, top], squares[top])
    said = [f"{name}: {w}" for name, model in models.items() for w in model.provenance.warnings]
    if joint is not None and lost > max(largest, LOST):
        said.append(
            f"the spring {joint.first} = {joint.second} is so stiff that rounding changes H by "
            f"about {lost:.0e}: a tie (--join {joint.first}={joint.second}) loses nothing"
        )
        warnings.warn(said[-1], ReductionWarning, stacklevel=2)
    worst = float(fields["error/worst"])
    if largest > 0 and 10 * largest < worst < np.inf:
        fields["log/plan"].append(
            f"note\tits error is {worst / largest:.2g} times that of its parts: reduce "
            f"{known.most or 'these'} to a smaller tolerance"
        )
    if varying:
        fields["error/parameter_values"] = values
        fields["error/parameter_values/names"] = list(varying)
        ranges = ", ".join(f"{name} {law.least:g} to {law.most:g}" for name, law in varying.items())
        count = f"{len(values)} combination{'s' if len(values) > 1 else ''} of values"
        fields["log/plan"].insert(1, f"values\t{ranges}: the claim is with {count}")
    fields["log/body"] = " with ".join(
        model.provenance.body or name for name, model in models.items()
    )
    if said:
        fields["log/warnings"] = said
    return ReducedModel(fields, lambda path: _write(fields, Path(path)))


class Held(NamedTuple):
    """A motion that a joint ties, or that its spring and damper act on."""

    joint: Joint
    direction: str
    weights: Floats  #: of the ports of all parts


def _joined(parts: Parts, held: Sequence[Held]) -> tuple[Floats, Floats, Floats, list[Term]]:
    """K, D, S and the terms of all parts with springs and dampers between them. Of what varies K
    holds the least stiffness, and a term the rest."""
    K, D, S, terms = parts.K.copy(), parts.D.copy(), parts.S.copy(), list(parts.terms)
    for joint, direction, weights in held:
        if joint.ties:
            continue
        moved = parts.B @ weights  # of q: what the outputs of the same ports measure
        square = np.outer(moved, moved)
        name = f"{joint.first}.{direction}"
        spring = joint.complex_stiffness(direction)
        if law := joint.parameters.get(name):
            spring = law.least * (1 + 1j * joint.loss)
            terms.append(Term(name, law, square))
        K, S = K + spring.real * square, S + spring.imag * square
        damper = joint.damping.get(direction, 0.0)
        if isinstance(damper, Parameter):
            name += ".damping"
            terms.append(Term(name, joint.parameters[name], square))
        else:
            D += damper * square
    return K, D, S, terms


#: What rounding of a stiff spring may change of H without a warning; and how many times what it
#: changes of eigenvalues, by estimate, it changes of H (beams, 1e10 to 1e14 N/m: 5 to 200).
LOST, OF_RESPONSE = 1e-6, 30.0


def _lost_by_springs(
    parts: Parts, held: Sequence[Held], shapes: Floats, squares: Floats
) -> tuple[Joint | None, float]:
    """The spring that costs H most digits, and about how much of H rounding changes there: the
    motions of its ends are sums over modes, and cancel in their difference.

    Parameters
    ----------
    shapes : (m, k) array
        Modes of the assembly, of unit modal mass, in the coordinates of the parts.
    squares : (k,) array
        Of their frequencies [rad²/s²].
    """
    found: tuple[Joint | None, float] = None, 0.0
    for joint, direction, weights in held:
        if joint.ties or not shapes.size:
            continue
        size = np.abs(parts.B @ weights) @ np.abs(shapes)
        stiffness = abs(joint.complex_stiffness(direction)) * size**2
        rounding = OF_RESPONSE * np.finfo(float).eps * stiffness
        lost = min(1.0, float((rounding / np.maximum(squares, rounding)).max()))
        if lost > found[1]:
            found = joint, lost
    return found


def _expect_moving(parts: Parts, held: Sequence[Held], left: Floats) -> None:
    """Springs and dampers act on a motion that the ties leave."""
    for joint, direction, weights in held:
        moved = parts.B @ weights
        if not joint.ties and np.linalg.norm(moved @ left) <= 1e-9 * np.linalg.norm(moved):
            raise BodyError(
                f"joint {joint.first} = {joint.second}: a spring or damper in {direction} does "
                "nothing, as a tie holds that motion: name the directions that are tied, "
                f"--join {joint.first}={joint.second}:x,y,z"
            )


def _rigid_motions(parts: Parts, held: Sequence[Held]) -> int:
    """How many rigid motions of the parts ties and springs leave. Frequencies do not tell: rounding
    of K leaves them at a ten-millionth of the highest."""
    free = []
    for model in parts.models.values():
        count = model.frame.rigid_modes
        is_first = model.frame.kind != "none" or not count
        shapes = np.eye(model.order) if is_first else NaturalModes.of(model).shapes
        free.append(shapes[:, :count])
    of_ports = scipy.linalg.block_diag(*free).T @ parts.B
    rows = []
    for joint, direction, weights in held:
        row = of_ports @ weights
        # Of ends on one body what cancels is rounding.
        size, ends = np.linalg.norm(row), np.linalg.norm(of_ports, axis=0) @ np.abs(weights)
        if size > 1e-9 * ends and (joint.ties or direction in joint.stiffness):
            rows.append(row / size)
    if not rows:
        return len(of_ports)
    values = np.linalg.svd(np.array(rows), compute_uv=False)
    return len(of_ports) - int(np.sum(values > 1e-8 * values[0]))


def _motions_left(ties: Sequence[Floats], count: int) -> Floats:
    """A basis (count, m) of the coordinates that ties leave, orthonormal."""
    if not ties:
        return np.eye(count)
    rows = np.array(ties)
    _, values, turned = np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None])
    held = int((values > 1e-9 * values[0]).sum())
    if len(rows) > count:
        raise BodyError(
            f"the joints hold {len(rows)} motions, and the parts have {count} coordinates: reduce "
            "them to larger orders"
        )
    if held < len(rows):
        raise BodyError(
            f"the joints hold {len(rows)} motions, of which the parts' coordinates tell {held} "
            "apart: two joints hold the same motion (leave out directions), or the parts are too "
            "small to move in all of them (reduce them with --statics yes)"
        )
    N: Floats = turned[len(rows) :].T
    return N


def _ends(joints: Sequence[Joint]) -> set[str]:
    """All interfaces that joints have."""
    return {name for joint in joints for name in (joint.first, joint.second)} - {GROUND}


def _interface(port: str) -> str:
    return port.rpartition(".")[0]


def _ports_left(
    parts: Parts, joints: Sequence[Joint], keep: Sequence[str]
) -> tuple[list[int], list[int]]:
    """Inputs and outputs of interfaces that are not joined, or kept."""
    joined = _ends(joints)
    for name in keep:
        if name not in joined:
            raise BodyError(f"keep {name}: no joint has it")
    gone = joined - set(keep)
    inputs = [i for i, p in enumerate(parts.inputs) if _interface(p) not in gone]
    outputs = [i for i, p in enumerate(parts.outputs) if _interface(p) not in gone]
    if not inputs or not outputs:
        raise BodyError(
            "every interface is used by a joint, a spring or a damper, and no port is left: keep "
            "one (--keep)"
        )
    return inputs, outputs


def _feedthrough(
    models: Mapping[str, ReducedBody],
    parts: Parts,
    joints: Sequence[Joint],
    inputs: list[int],
    outputs: list[int],
) -> Floats:
    """That of the ports that are left; a joint's force may have none."""
    direct = scipy.linalg.block_diag(*(m.system.feedthrough for m in models.values()))
    for i, j in np.argwhere(direct):
        if _interface(parts.inputs[j]) in _ends(joints) and i in outputs:
            raise BodyError(
                f"{parts.outputs[i]} takes a share of {parts.inputs[j]} at once, "
                "with no motion between, and a joint's force is no input: leave it "
                "out (--outputs)"
            )
    left: Floats = direct[np.ix_(outputs, inputs)]
    return left


def _claim(known: AssemblyBound) -> dict[str, Any]:
    """Fields of ``/error``."""
    closed = {name: worst for name, worst in known.by_kind.items() if worst < np.inf}
    worst = float(known.bound.max(initial=0))
    if known.kind != "estimated":
        worst = max([known.worst, *closed.values()])
    has_estimate = np.isfinite(known.estimate).any()
    fields = {
        "error/omega": known.omega,
        "error/relative": known.estimate if has_estimate else known.bound,
        "error/bound": known.bound,
        "error/kind": known.kind,
        "error/worst": worst,
        "error/unclaimed": [name for name in known.by_kind if name not in closed],
        "error/kinds": list(closed),
        "error/by_kind": np.array(list(closed.values())),
        "error/relative_to": "pointwise",
    }
    if known.kind != "estimated":
        fields["error/whole"] = known.worst
    if known.kind == "certified outside":
        fields["error/excluded"] = known.open
    return fields


def _symmetric(A: Floats) -> Floats:
    return 0.5 * (A + A.T)


def _write(fields: Mapping[str, Any], path: Path) -> None:
    """A reduced file of these fields."""
    with written_aside(path) as place, h5py.File(place, "w") as file:
        for name, value in fields.items():
            of_another = name.rpartition("/")[0] in fields
            if isinstance(value, np.ndarray) and name != "band" and not of_another:
                file[name] = value
        for name, value in fields.items():
            group, _, key = name.rpartition("/")
            if name not in file:
                at = (
                    file.require_group(group) if group and group not in file else file[group or "/"]
                )
                at.attrs[key] = value
