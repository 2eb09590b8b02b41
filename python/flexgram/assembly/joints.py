"""Joints between interfaces of reduced bodies, and the bodies side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, Floats, meant
from flexgram.body.laws import viscous
from flexgram.body.terms import Term
from flexgram.body.varying_laws import Parameter, Product, product
from flexgram.model.internal_variables import rounding_of_variables, with_internal_variables
from flexgram.model.reduced import ReducedBody
from flexgram.model.response import expect_collocated

GROUND = "ground"
#: A turn of less is none: rounding of whole ones.
TURNED = 1e-12
#: Directions of a joint by the ports that move in them.
PORTS = {"x": "fx", "y": "fy", "z": "fz", "rx": "mx", "ry": "my", "rz": "mz"}


def _now(known: Mapping[str, float | Parameter], direction: str) -> float:
    value = known.get(direction, 0.0)
    return value.value if isinstance(value, Parameter) else value


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
        [N/m], [N m/rad] and [N s/m], [N m s/rad] by direction; both empty: tied. One that is known
        between two numbers is ``flexgram.parameter(least, most)``: a parameter of the assembly,
        ``part.interface.direction`` of a stiffness, ``part.interface.direction.damping``.
    loss : float
        Loss factor of the stiffness.
    """

    first: str
    second: str
    directions: Sequence[str] = ()
    stiffness: Mapping[str, float | Parameter] = field(default_factory=dict)
    damping: Mapping[str, float | Parameter] = field(default_factory=dict)
    loss: float = 0.0

    @property
    def ties(self) -> bool:
        return not self.stiffness and not self.damping

    def complex_stiffness(self, direction: str) -> complex:
        """k (1 + i loss); of a parameter the present value."""
        return _now(self.stiffness, direction) * (1 + 1j * self.loss)

    def damper(self, direction: str) -> float:
        """The damping; of a parameter the present value."""
        return _now(self.damping, direction)

    @property
    def parameters(self) -> dict[str, Parameter | Product]:
        """Of its stiffness and damping, by their names in the assembly."""
        return {
            **{
                f"{self.first}.{direction}": replace(known, loss=self.loss)
                for direction, known in self.stiffness.items()
                if isinstance(known, Parameter)
            },
            **{
                f"{self.first}.{direction}.damping": product(known, viscous())
                for direction, known in self.damping.items()
                if isinstance(known, Parameter)
            },
        }

    def at(self, values: Mapping[str, float]) -> Joint:
        """The joint with values of its parameters; of those that are not named the present ones.

        Raises
        ------
        BodyError
            For a value that is not between its two numbers.
        """
        known = {
            name.removeprefix(f"{self.first}."): law.with_value(
                values.get(name, law.value), name
            ).value
            for name, law in self.parameters.items()
        }
        return replace(
            self,
            stiffness={d: known.get(d, k) for d, k in self.stiffness.items()},
            damping={d: known.get(f"{d}.damping", c) for d, c in self.damping.items()},
        )


def _rotation(turn: ArrayLike | None) -> Floats:
    """The matrix from the axes of a part to those of the assembly, of a rotation vector [rad]."""
    if turn is None:
        return np.eye(3)
    vector = np.asarray(turn, dtype=float)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise BodyError(f"turn = {turn!r} must be three finite numbers, a rotation vector")
    across = np.cross(vector, np.eye(3)).T  # x -> v × x
    return np.asarray(scipy.linalg.expm(across), dtype=float)


class Parts:
    """The parts side by side, and combinations of their ports."""

    def __init__(
        self,
        models: Mapping[str, ReducedBody],
        turns: Mapping[str, ArrayLike],
        joints: Sequence[Joint] = (),
        *,
        internal_variables: bool = False,
    ) -> None:
        """A loss factor that all parts have stays ``eta`` where no spring is among the joints; what
        parts have of their own goes into ``S``. With ``internal_variables`` Prony terms are
        coordinates without mass, and ``rounding`` says how far these are from the terms, in the
        norm of K + τM of the parts; else they and parameters are ``terms``."""
        self.models = dict(models)
        for name in turns:
            if name not in models:
                raise BodyError(f"there is no part {name} to turn; there are {', '.join(models)}")
        self.turn = {name: _rotation(turns.get(name)) for name in models}
        self.rounding = 0.0
        if internal_variables:
            for name, model in models.items():
                system, tau = model.system, float(model.claim.bands.max()) ** 2 / 4
                of_part = rounding_of_variables(system, system.K + tau * system.M)
                self.rounding = max(self.rounding, of_part)
                self.models[name] = model.with_parts(system=with_internal_variables(system))
            models = self.models
        systems = [m.system for m in models.values()]
        etas = {system.eta for system in systems}
        common = len(etas) == 1 and all(joint.ties for joint in joints)
        self.eta = etas.pop() if common else 0.0
        self.S = scipy.linalg.block_diag(
            *((s.eta - self.eta) * s.K + (s.S if s.S.any() else 0.0) for s in systems)
        )
        blocks = [
            (m.system.M, m.system.D, m.system.K, m.system.B, m.system.C) for m in models.values()
        ]
        self.M, self.D, self.K, self.B, self.C = (
            scipy.linalg.block_diag(*parts) for parts in zip(*blocks, strict=True)
        )
        self.terms = [
            Term(f"{n}.{term.name}", term.law, self._alone(n, term.matrix))
            for n, m in models.items()
            for term in m.system.terms
        ]
        self.inputs = [f"{n}.{p}" for n, m in models.items() for p in m.inputs]
        self.outputs = [f"{n}.{p}" for n, m in models.items() for p in m.outputs]
        for names in (self.inputs, self.outputs):
            twice = [name for name in names if names.count(name) > 1]
            if twice:
                raise BodyError(f"{twice[0]} is a port of two parts: give one another name")

    def _alone(self, part: str, matrix: Floats) -> Floats:
        """A matrix of a part among zeros of the others."""
        whole: Floats = scipy.linalg.block_diag(
            *(
                matrix if name == part else np.zeros((m.order, m.order))
                for name, m in self.models.items()
            )
        )
        return whole

    def part_of(self, port: str) -> str:
        for name in sorted(self.models, key=len, reverse=True):
            if port.startswith(name + "."):
                return name
        there = ", ".join(self.models)
        raise BodyError(f"{port}: there is no such part; there are {there} (NAME=FILE renames)")

    def has(self, interface: str) -> list[str]:
        """Directions in which an interface can be tied."""
        part = self.part_of(interface)
        there = [
            d
            for d, f in PORTS.items()
            if f"{interface}.{f}" in self.inputs and f"{interface}.{f}" in self.outputs
        ]
        if not there:
            both = [p for p in self.inputs if p in self.outputs]
            ends = set(PORTS.values())
            names = sorted({p.rpartition(".")[0] for p in both if p.rpartition(".")[2] in ends})
            known = f"there are {', '.join(names)}" if names else "the parts have none"
            own = [p for p in both if p.rpartition(".")[0] == interface]
            if own:
                raise BodyError(
                    f"{interface} has ports without directions ({', '.join(own[:3])}: rows of "
                    "matrices), and a joint needs fx … mz: name their directions at the import, "
                    f"--rows NAME=fx:25,fy:26; {known}"
                )
            raise BodyError(f"{interface} is no interface{meant(interface, names)}; {known}")
        whole = [
            d
            for group in ("x y z", "rx ry rz")
            for d in group.split()
            if set(group.split()) <= set(there)
        ]
        plain = np.abs(self.turn[part] - np.eye(3)).max() <= TURNED
        return there if plain else whole

    def expect_collocated(self, interface: str) -> None:
        """What an interface measures is what it drives."""
        for force in PORTS.values():
            name = f"{interface}.{force}"
            if name in self.inputs and name in self.outputs:
                expect_collocated(
                    name, self.C[self.outputs.index(name)], self.B[:, self.inputs.index(name)]
                )

    def port(self, interface: str, direction: str) -> Floats:
        """The combination of inputs (and of the same outputs) that moves an interface in a
        direction of the assembly."""
        R = self.turn[self.part_of(interface)]
        axis = np.eye(3)["xyz".index(direction[-1])]
        local = R.T @ axis
        weights = np.zeros(len(self.inputs))
        for share, letter in zip(local, "xyz", strict=True):
            if abs(share) > TURNED:
                force = PORTS[("r" if direction[0] == "r" else "") + letter]
                weights[self.inputs.index(f"{interface}.{force}")] = share
        return weights


def tied(parts: Parts, joint: Joint) -> list[tuple[str, Floats]]:
    """Directions of a joint with the combination of ports that it holds together."""
    words = f"joint {joint.first} = {joint.second}"
    if joint.first == joint.second:
        raise BodyError(f"{words}: an interface with itself")
    first = parts.has(joint.first)
    parts.expect_collocated(joint.first)
    second = first
    if joint.second != GROUND:
        second = parts.has(joint.second)
        parts.expect_collocated(joint.second)
    own = {**joint.stiffness, **joint.damping}
    for direction, known in (*joint.stiffness.items(), *joint.damping.items()):
        if isinstance(known, Parameter) and (known.loss or known.slope != 1):
            raise BodyError(
                f"{words}: {direction} is a stiffness, or a damping: give no slope, and a loss "
                "factor as that of the joint"
            )
        value = known.least if isinstance(known, Parameter) else known
        if direction not in PORTS or (joint.directions and direction not in joint.directions):
            raise BodyError(
                f"{words}: {direction} must be one of {', '.join(joint.directions or PORTS)}"
            )
        if not (np.isfinite(value) and value > 0):
            raise BodyError(f"{words}: {direction} = {value} must be positive")
    if not (np.isfinite(joint.loss) and joint.loss >= 0) or (joint.loss and not joint.stiffness):
        raise BodyError(f"{words}: a loss factor, {joint.loss}, is one of springs, not negative")
    if own and set(joint.directions) - set(own):
        raise BodyError(f"{words}: no stiffness or damping in {joint.directions[0]}")
    wanted = (
        list(joint.directions)
        or [d for d in PORTS if d in own]
        or [d for d in PORTS if d in first and d in second]
    )
    if not wanted:
        raise BodyError(
            f"{words}: they have no direction in common ({', '.join(first) or 'none'} and "
            f"{', '.join(second) or 'none'})"
        )
    either = {d for d in "xyz" if d in first or d in second}
    if not joint.directions and not own and joint.second != GROUND and either - set(wanted):
        raise BodyError(
            f"{words}: they have {', '.join(wanted)} in common, and one has no "
            f"{', '.join(sorted(either - set(wanted)))} (it is held there, or that is no port): "
            "name the directions that are meant"
        )
    result = []
    for direction in wanted:
        if direction not in PORTS:
            raise BodyError(f"{words}: {direction} must be one of {', '.join(PORTS)}")
        for name, there in ((joint.first, first), (joint.second, second)):
            if direction not in there:
                raise BodyError(f"{words}: {name} has no {direction}")
        sign = parts.port(joint.first, direction)
        if joint.second != GROUND:
            sign = sign - parts.port(joint.second, direction)
        result.append((direction, sign))
    return result


def common_bands(all_bands: Sequence[Floats]) -> Floats:
    """Where every part is claimed to be good."""
    common = [tuple(band) for band in all_bands[0]]
    for bands in all_bands[1:]:
        common = [
            (max(a, c), min(b, d)) for a, b in common for c, d in bands if max(a, c) <= min(b, d)
        ]
    if not common:
        raise BodyError("the parts' bands have no frequency in common")
    return np.array(common)
