"""Parameters of assemblies: stiffness and damping that are known between two numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import TypeVar

import numpy as np

from flexgram.assembly.joints import Joint
from flexgram.basics import BodyError, Floats
from flexgram.body.varying_laws import Parameter, Product, Varying
from flexgram.model.reduced import ReducedBody

Body = TypeVar("Body", bound=ReducedBody)

#: With more combinations of values the claim is looked at with the ends of all together.
MOST_COMBINATIONS = 32


def parameters_of(
    models: Mapping[str, ReducedBody], joints: Sequence[Joint]
) -> dict[str, Parameter | Product]:
    """``part.NAME`` of parts, ``part.interface.direction`` of springs, and with ``.damping`` of
    dampers.

    Raises
    ------
    BodyError
        For two of one name.
    """
    found: dict[str, Parameter | Product] = {}
    of_parts = [
        (f"{part}.{name}", law)
        for part, model in models.items()
        for name, law in model.system.parameters.items()
    ]
    law: Varying
    for name, law in [*of_parts, *(pair for joint in joints for pair in joint.parameters.items())]:
        if not isinstance(law, (Parameter, Product)):
            raise BodyError(f"{name} is a range of speeds: assemblies take bodies that do not turn")
        if name in found:
            raise BodyError(
                f"two parameters of the assembly are named {name}: two springs at one interface "
                "can vary in different directions only, and two dampers"
            )
        found[name] = law
    return found


def with_values(
    models: Mapping[str, Body], joints: Sequence[Joint], values: Mapping[str, float]
) -> tuple[dict[str, Body], list[Joint]]:
    """Parts and joints with values of the assembly's parameters."""
    parts = {}
    for part, model in models.items():
        own = model.system.parameters
        given = {name: values[f"{part}.{name}"] for name in own if f"{part}.{name}" in values}
        parts[part] = model.at(**given) if own else model
    return parts, [joint.at(values) for joint in joints]


def _evenly(law: Parameter | Product, count: int) -> list[float]:
    """From the least to the most, in equal ratios (in equal steps from zero)."""
    make = np.geomspace if law.least > 0 else np.linspace
    between = make(law.least, law.most, count)[1:-1]
    return [law.least, *map(float, between), law.most]


def combinations(models: Mapping[str, ReducedBody], joints: Sequence[Joint]) -> Floats:
    """Values of the parameters for which the claim is looked at, (k, d), the present ones first.

    Those of a part are values with which its own claim is proved. Where parts or springs vary
    together, both ends of each are combined; of too many all least and all most ones are taken.
    """
    sources: list[tuple[Floats, Floats, Floats]] = []  # present, least and most, other values
    for model in models.values():
        if own := model.system.parameters:
            rows = model.claim.parameter_values
            order = [model.claim.parameters.index(name) for name in own if len(rows)]
            sources.append(_source(list(own.values()), rows[:, order] if len(rows) else rows))
    laws = [law for joint in joints for law in joint.parameters.values()]
    count = 5 if len(laws) == 1 else 2
    sources += [_source([law], np.array(_evenly(law, count))[:, None]) for law in laws]
    if not sources:
        return np.zeros((1, 0))
    present = np.concatenate([now for now, _, _ in sources])
    if len(sources) == 1:
        rows = sources[0][2]
    elif np.prod([float(len(ends)) for _, ends, _ in sources]) < MOST_COMBINATIONS:
        rows = np.array([np.concatenate(of) for of in product(*(ends for _, ends, _ in sources))])
    else:
        rows = np.array([np.concatenate([ends[end] for _, ends, _ in sources]) for end in (0, -1)])
    others = [row for row in rows if not np.allclose(row, present, rtol=1e-12, atol=0)]
    return np.array([present, *others])


def _source(laws: Sequence[Varying], rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Present values, those with each parameter at an end, all."""
    present = np.array([law.value for law in laws])
    if not rows.size:
        return present, present[None], present[None]
    ends = np.array([[law.least, law.most] for law in laws])
    at_ends = np.isclose(rows[:, :, None], ends, rtol=1e-12, atol=0).any(axis=2).all(axis=1)
    chosen = rows[at_ends] if at_ends.any() else present[None]
    return present, chosen[np.lexsort(chosen.T[::-1])], rows
