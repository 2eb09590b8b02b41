"""Natural modes of bodies with terms: each with the stiffness at its own frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from flexgram.basics import Floats
from flexgram.body.varying_laws import Parameter, Product
from flexgram.model.modes import natural_modes
from flexgram.model.reduced import ReducedBody
from flexgram.model.system import System


def modes_of(system: System) -> tuple[Floats, Floats]:
    """Squares [rad²/s²] of the natural frequencies, ascending, and the modes (m, m).

    Without terms those of K and M (``natural_modes``). With them the j-th mode is that of
    K + Σ Re g(ω_j) T, by iteration; such modes are nearly orthogonal in M.
    """
    squares, modes = natural_modes(system.K, system.M)
    if not system.terms:
        return squares, modes
    squares, modes = squares.copy(), modes.copy()
    square = 0.0  # of the last mode, which is near the next
    for j in range(len(squares)):
        if not np.isfinite(squares[j]):
            break
        square = max(square, squares[j])
        for _ in range(20 if squares[j] > 0 else 0):
            stiffer = [t.law.at(np.sqrt(square)).real * t.matrix for t in system.terms]
            every, shapes = natural_modes(system.K + sum(stiffer), system.M)
            before, square = square, every[j]
            squares[j], modes[:, j] = square, shapes[:, j]
            if not abs(square - before) > 1e-10 * square:
                break
    return squares, modes


def sensitivities(system: System) -> dict[str, Floats]:
    """Of each parameter the relative change of the natural frequencies by its relative change,
    (p/ω) dω/dp = p slope φᵀTφ/(2ω²), at present values; (k,) by ``modes_of`` of these."""
    squares, modes = modes_of(system.at())
    heavy = np.isfinite(squares) & (squares > 1e-12 * np.abs(squares[np.isfinite(squares)]).max())
    found: dict[str, Floats] = {}
    omega = np.sqrt(np.maximum(np.where(heavy, squares, 0), 0))
    for term in system.terms:
        law = term.law
        if not isinstance(law, (Parameter, Product)):
            continue
        share = law.at(omega).real if isinstance(law, Product) else law.slope * law.value
        energy = np.diag(modes.T @ term.matrix @ modes) * share
        change = np.where(heavy, energy / (2 * np.where(heavy, squares, 1)), 0)
        name = law.parameter(term.name)
        found[name] = found[name] + change if name in found else change
    return found


def natural_frequencies(model: ReducedBody) -> Floats:
    """``modes`` of the body [rad/s]; with terms each with the stiffness at its own frequency. With
    gyroscopic forces the frequencies of its poles."""
    if model.system.is_gyroscopic:
        whirl: Floats = np.sort(model.system.at().poles().imag)
        return whirl[whirl > 0]
    if not model.system.terms:
        return model.modes
    squares = modes_of(model.system)[0]
    omega: Floats = np.sqrt(np.maximum(squares[np.isfinite(squares)], 0))
    return omega


def losses(system: System, squares: Floats, modes: Floats) -> Floats:
    """Loss factor of each mode beside eta: φᵀ(S + Σ Im g(ω) T)φ/ω²; ω² = ``squares``, of unit
    modal mass."""
    own = np.diag(modes.T @ system.S @ modes).copy()
    omega = np.sqrt(np.maximum(np.where(np.isfinite(squares), squares, 0), 0))
    for term in system.terms:
        own += np.diag(modes.T @ term.matrix @ modes) * term.law.at(omega).imag
    eta: Floats = own / np.maximum(np.abs(squares), 1e-300)
    return eta


@dataclass(frozen=True)
class NaturalModes:
    """Natural modes of a reduced body, with present values of its parameters.

    Attributes
    ----------
    model : ReducedBody
        Without parameters.
    omega : (m,) array
        [rad/s]
    shapes : (m, m) array
        A column each, in generalised coordinates.
    rigid : int
        How many come first that are rigid.
    """

    model: ReducedBody
    omega: Floats
    shapes: Floats
    rigid: int

    @classmethod
    def of(cls, model: ReducedBody) -> Self:
        now = model.at() if model.system.parameters else model
        squares, shapes = modes_of(now.system)
        omega = np.sqrt(np.maximum(squares, 0))
        largest = omega[np.isfinite(omega)].max(initial=0)
        rigid = max(int(np.sum(omega < 1e-6 * max(largest, 1e-300))), model.frame.rigid_modes)
        omega[:rigid] = 0
        return cls(now, omega, shapes, rigid)

    def elastic(self, count: int) -> tuple[Floats, Floats]:
        """Frequencies [Hz] and shapes (k, m) of the first elastic ones."""
        chosen = np.flatnonzero(np.isfinite(self.omega))[self.rigid :][:count]
        return self.omega[chosen] / (2 * np.pi), self.shapes[:, chosen].T
