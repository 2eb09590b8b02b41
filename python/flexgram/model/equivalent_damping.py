"""Viscous damping in the place of a loss factor, which exists in frequency only."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from scipy.optimize import nnls

from flexgram.basics import BodyError, Floats
from flexgram.body.laws import Circulatory, Prony
from flexgram.body.terms import Term
from flexgram.model.damped_modes import losses, modes_of
from flexgram.model.reduced import ReducedBody
from flexgram.model.system import System

Body = TypeVar("Body", bound=ReducedBody)
KINDS = ("modal", "rayleigh")


def _with_frequencies(system: System, modes: Floats, omega: Floats) -> Floats:
    """K with these natural frequencies, its modes as near to the given ones as M allows."""
    mass, turn = np.linalg.eigh(modes.T @ system.M @ modes)
    if not mass[0] > 1e-9 * mass[-1]:
        raise BodyError(
            "the modes at their own frequencies are not independent: no viscous damping stands "
            "for these materials (Prony terms have a state space)"
        )
    shapes = system.M @ modes @ (turn / np.sqrt(mass)) @ turn.T
    K: Floats = shapes @ np.diag(omega**2) @ shapes.T
    return 0.5 * (K + K.T)


def with_viscous_damping(
    model: Body, kind: str = "modal", *, keep_relaxation: bool = False
) -> tuple[Body, float]:
    """The body with viscous damping in the place of its loss factors: eta, and those of materials.

    Of viscoelastic materials (terms) each mode keeps the stiffness at its own frequency too.

    ``modal``: every elastic mode φ gets the damping ratio η/2 with its own η = eta + φᵀSφ/(φᵀKφ),
    so that H agrees at resonances: D + M Φ diag(η ω) Φᵀ M. ``rayleigh``: D + alpha M + beta K,
    fitted to η/2 at the modes in the band; it damps rigid motion too.

    Parameters
    ----------
    model : ReducedBody
    kind : str
        One of ``KINDS``.
    keep_relaxation : bool
        Prony terms stay, which have a form in time, and only loss factors are replaced; not where
        tables are to be replaced too, whose stiffness goes into that of the modes.

    Returns
    -------
    body, error
        ``error``: the largest ‖H' - H‖/‖H‖ over the frequencies of the claim and the resonances in
        the band. The claim of the body stays that of the body with eta; a warning says so.

    Raises
    ------
    BodyError
        For another kind, or without a loss factor.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> rom.eta = 0.02
    >>> viscous, error = with_viscous_damping(rom)
    >>> viscous.eta, error < 0.05
    (0.0, True)
    """
    if model.system.parameters:
        model = model.at()
    system = model.system
    if kind not in KINDS:
        raise BodyError(f"damping {kind}: must be one of {', '.join(KINDS)}")
    if any(isinstance(term.law, Circulatory) for term in system.terms):
        raise BodyError(
            f"damping {kind} replaces loss factors; the body has circulatory forces, which no "
            "damper replaces"
        )
    kept: tuple[Term, ...] = ()
    if keep_relaxation and all(isinstance(term.law, Prony) for term in system.terms):
        kept = system.terms
    replaced = replace(system, terms=()) if kept else system
    if not replaced.loss:
        raise BodyError(f"damping {kind}: the body has no loss factor that it could replace")
    squares, modes = modes_of(system)
    heavy = np.isfinite(squares)
    omega = np.sqrt(np.maximum(np.where(heavy, squares, 0), 0))
    omega[: model.frame.rigid_modes] = 0
    omega[omega < 1e-6 * omega.max(initial=0)] = 0
    moves = omega > 0
    own = system.eta + np.where(moves, losses(replaced, omega**2, modes), 0)  # of each mode
    stiffness = _with_frequencies(system, modes, omega) if replaced.terms else system.K
    if kind == "modal":
        shapes = system.M @ modes
        D = shapes @ np.diag(own * omega) @ shapes.T
    else:
        first, last = model.claim.bands.min(), model.claim.bands.max()
        inside = moves & (omega >= first) & (omega <= last)
        at, wanted = omega[inside], own[inside]
        if len(at) < 2:
            at = np.array([max(first, 0.1 * last), last])
            wanted = np.full(2, own[moves].mean() if moves.any() else system.eta)
        rows = np.column_stack([0.5 / at, 0.5 * at])
        alpha, beta = nnls(rows, 0.5 * wanted)[0]
        D = alpha * system.M + beta * stiffness
    if system.output_eta.any():
        raise BodyError(
            "reactions hold the loss factor too, and have no such equivalent: leave them out "
            "(--outputs)"
        )
    none = np.zeros_like(system.S)
    viscous = replace(
        system, K=stiffness, D=system.D + 0.5 * (D + D.T), eta=0.0, S=none, terms=kept
    )
    band = np.unique(np.concatenate([model.claim.omega, omega[omega > 0]]))
    band = band[(band >= model.claim.bands.min()) & (band <= model.claim.bands.max()) & (band > 0)]
    H, other = system.transfer(band), viscous.transfer(band)
    sizes = np.linalg.norm(H, axis=(1, 2))
    error = float((np.linalg.norm(other - H, axis=(1, 2)) / sizes).max(initial=0))
    lost = "the relaxation of materials" if replaced.terms else "the loss factor"
    words = (
        f"{lost} ({replaced.loss}) is replaced by {kind} viscous damping; it changes H by "
        f"{error:.1e} at most at {len(band)} frequencies of the band; the claim is of the body "
        f"with {lost}"
    )
    made = replace(model.provenance, warnings=[*model.provenance.warnings, words])
    return model.with_parts(system=viscous, provenance=made), error
