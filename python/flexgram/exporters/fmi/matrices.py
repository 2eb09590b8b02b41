"""The state space of a functional mock-up unit, and what parameters of the body change in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import scipy.linalg

from flexgram.basics import BodyError, Floats
from flexgram.body.laws import Prony, Viscous
from flexgram.body.terms import Term
from flexgram.body.varying_laws import Coriolis, Parameter, Product, Spin, Varying
from flexgram.model.internal_states import InternalStates
from flexgram.model.reduced import ReducedBody
from flexgram.model.system import RATES, System


@dataclass(frozen=True)
class Gain:
    """What the body has for each unit of ``parameter`` to the ``power``.

    Attributes
    ----------
    parameter : str
    power : int
    stiffness, damping, gyroscopic : (m, m) arrays
    force : (m, k) array
        On the coordinates, of internal states.
    """

    parameter: str
    power: int
    stiffness: Floats
    damping: Floats
    gyroscopic: Floats
    force: Floats


@dataclass(frozen=True)
class StateSpace:
    """x' = (A0 + d A1) x + B u, y = (C0 + d C1) x + D u with the factor d of the damping. Each row
    k of ``gains`` adds (p^power - present^power) times what it holds to these four matrices.

    x are the coordinates, each times its own frequency (so that they are as large as their
    velocities), the velocities, and the internal states of Prony terms.

    Attributes
    ----------
    A0, A1 : (n, n) arrays
    B : (n, n_in) array
    C0, C1 : (n_y, n) arrays
    D : (n_y, n_in) array
    parameters : dict of str to Varying
        By name, in the order of their numbers.
    gains : list of tuple
        The number of the parameter, the power, and what is added to A0, A1, C0 and C1.
    """

    A0: Floats
    A1: Floats
    B: Floats
    C0: Floats
    C1: Floats
    D: Floats
    parameters: dict[str, Varying] = field(default_factory=dict)
    gains: list[tuple[int, int, list[Floats]]] = field(default_factory=list)

    @classmethod
    def of(cls, model: ReducedBody, rates: Sequence[str]) -> Self:
        """Of a reduced body, with these rates of its outputs.

        Raises
        ------
        BodyError
            If doubles cannot hold it.
        """
        varying, now = model.system, model.system.at()
        inner, gains = _internal_states(varying)
        m, skew = varying.order, 0.5 * (now.D - now.D.T)
        size = _sizes(now)
        mass = scipy.linalg.cho_factor(now.M)

        def solved(forces: Floats) -> Floats:
            accelerations: Floats = scipy.linalg.cho_solve(mass, forces)
            return accelerations

        n, speeds, states = 2 * m + inner.count, slice(m, 2 * m), slice(2 * m, None)
        A0, A1, B = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, len(now.inputs)))
        A0[:m, speeds] = np.diag(size)
        A0[speeds, :m] = -solved(now.K + inner.stiffness) / size
        A0[speeds, speeds] = -solved(skew)
        A0[speeds, states] = solved(inner.force)
        A0[states, :m], A0[states, states] = inner.drive / size, -np.diag(inner.rate)
        A1[speeds, speeds] = -solved(now.D - skew)
        B[speeds] = solved(now.B)
        zero, none = np.zeros_like(now.C), np.zeros((len(now.C), inner.count))
        nothing = np.zeros((len(now.C), n))
        rows = {
            "displacement": (
                np.hstack([now.C / size, zero, none]),
                np.hstack([zero, now.C_rate, none]),
                now.feedthrough,
            ),
            "velocity": (np.hstack([zero, now.C, none]), nothing, np.zeros_like(now.feedthrough)),
            "acceleration": (now.C @ A0[speeds], now.C @ A1[speeds], now.C @ B[speeds]),
        }
        C0, C1, D = (np.vstack([rows[rate][k] for rate in rates]) for k in range(3))
        found = cls(A0, A1, B, C0, C1, D, varying.parameters)
        for gain in gains:
            of_0, of_1 = np.zeros((n, n)), np.zeros((n, n))
            of_0[speeds, :m] = -solved(gain.stiffness) / size
            of_0[speeds, speeds] = -solved(gain.gyroscopic)
            of_0[speeds, states] = solved(gain.force)
            of_1[speeds, speeds] = -solved(gain.damping)
            outputs = [
                np.vstack([now.C @ a[speeds] if r == "acceleration" else nothing for r in rates])
                for a in (of_0, of_1)
            ]
            number = list(found.parameters).index(gain.parameter)
            found.gains.append((number, gain.power, [of_0, of_1, *outputs]))
        found._expect(model, rates)
        return found

    def at(self, values: Mapping[str, float]) -> tuple[Floats, Floats]:
        """A and C with these values of the parameters, and damping as it is."""
        names, laws = list(self.parameters), list(self.parameters.values())
        A, C = self.A0 + self.A1, self.C0 + self.C1
        for number, power, (A0, A1, C0, C1) in self.gains:
            factor = values[names[number]] ** power - laws[number].value ** power
            A, C = A + factor * (A0 + A1), C + factor * (C0 + C1)
        return A, C

    def _expect(self, model: ReducedBody, rates: Sequence[str]) -> None:
        """Rounding of stiff beside soft coordinates must not count: in displacements at both ends
        of the band, in their rates beside the largest there."""
        bands, rows = model.claim.bands, len(model.outputs)
        ends = (1.001 * bands[0, 0] or 1e-3 * bands[-1, 1], 0.997 * bands[-1, 1])
        for which in ("least", "value", "most")[0 if self.parameters else 1 :]:
            values = {name: getattr(law, which) for name, law in self.parameters.items()}
            system, (A, C) = model.system.at(values), self.at(values)
            lost, size = np.zeros((2, len(ends), len(rates)))
            for k, w in enumerate(ends):
                H = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, self.B) + self.D
                motion = system.transfer(w)
                for r, rate in enumerate(rates):
                    expected = (1j * w) ** RATES.index(rate) * motion
                    lost[k, r] = np.linalg.norm(H[r * rows : (r + 1) * rows] - expected)
                    size[k, r] = np.linalg.norm(expected)
            for r, rate in enumerate(rates):
                allowed = 1e-6 * (size[:, r] if rate == "displacement" else size[:, r].max())
                if not np.all(lost[:, r] <= allowed):
                    raise BodyError(
                        f"the stiffnesses of the body differ too much for the {rate}s of a state "
                        "space in doubles: take other outputs, a smaller order or band, or "
                        "consistent mass if its own is lumped (mass_integration: full; "
                        "PARAM,COUPMASS,1)"
                    )
            if not self.parameters:
                break


def _internal_states(system: System) -> tuple[InternalStates, list[Gain]]:
    """The internal states of all terms, with the forces of the present values, and the gains of
    the parameters. Of a parameter that multiplies Prony terms the force changes, not the states."""
    m = system.order
    parts: list[tuple[InternalStates, Term]] = []
    for term in system.terms:
        law = term.law.factor if isinstance(term.law, Product) else term.law
        if isinstance(law, Prony):
            parts.append((InternalStates.of([Term(term.name, law, term.matrix)], m), term))
    count = sum(part.count for part, _ in parts)
    stiffness, forces, at, gains = np.zeros((m, m)), [np.zeros((m, 0))], 0, []
    nothing = np.zeros((m, m))
    still = Gain("", 1, nothing, nothing, nothing, np.zeros((m, count)))
    for part, term in parts:
        own = slice(at, at + part.count)
        at += part.count
        times = 1.0
        if isinstance(term.law, Product):
            times, slope = term.law.times, term.law.slope
            force = np.zeros((m, count))
            force[:, own] = slope * part.force
            name = term.law.parameter(term.name)
            gains.append(
                replace(still, parameter=name, stiffness=slope * part.stiffness, force=force)
            )
        stiffness = stiffness + times * part.stiffness
        forces.append(times * part.force)
    for term in system.terms:
        if isinstance(term.law, Varying):
            gain = replace(still, parameter=term.law.parameter(term.name))
            gains += _instant(term, gain)
    inner = InternalStates(
        stiffness,
        np.hstack(forces),
        np.vstack([np.zeros((0, m)), *(part.drive for part, _ in parts)]),
        np.concatenate([np.zeros(0), *(part.rate for part, _ in parts)]),
        np.concatenate([np.zeros(0), *(part.share for part, _ in parts)]),
    )
    return inner, gains


def _instant(term: Term, gain: Gain) -> list[Gain]:
    """What a parameter changes that needs no states."""
    law, T = term.law, term.matrix
    if isinstance(law, Parameter):
        return [replace(gain, stiffness=law.slope * T, damping=law.beta * law.slope * T)]
    if isinstance(law, Spin):
        return [replace(gain, power=law.power, stiffness=T)]
    if isinstance(law, Coriolis):
        return [replace(gain, gyroscopic=T)]
    if isinstance(law, Product) and isinstance(law.factor, Viscous):
        return [replace(gain, damping=law.slope * T)]
    return []


def _sizes(system: System) -> Floats:
    """Of each coordinate its own frequency."""
    squares = np.diag(system.K) / np.diag(system.M)
    least = 1e-12 * squares.max() if squares.max() > 0 else 1.0
    sizes: Floats = np.sqrt(np.maximum(squares, least))
    return sizes
