"""What is left of a free reduced body without its rigid motion: in its own frame, for a floating
frame of reference, and without its rigid modes, for the elastic part of H.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from flexgram.basics import BodyError
from flexgram.model.frame import Frame
from flexgram.model.modes import natural_modes
from flexgram.model.reduced import ReducedBody

Body = TypeVar("Body", bound=ReducedBody)


def expect_one_body(rom: ReducedBody, what: str) -> None:
    """Raise BodyError for assemblies, and where parts of a body move by themselves."""
    if rom.basis.parts:
        names = ", ".join(rom.basis.parts)
        raise BodyError(
            f"{what} takes one body, and this is an assembly: export its parts ({names}), and join "
            "them in the multibody code"
        )
    if (count := rom.frame.rigid_modes) > 6:
        raise BodyError(
            f"{what} takes one body with six rigid modes, and this has {count}: loose parts or "
            "hinges move by themselves"
        )


def in_its_frame(rom: Body) -> Body:
    """``ReducedModel.elastic``."""
    count, system = rom.frame.rigid_modes, rom.system
    if count == 0:
        return rom
    if rom.frame.kind == "none":
        raise BodyError(
            "the basis mixes rigid with elastic motion (--frame none or "
            "--method pod): reduce with --method two_step and --frame "
            "buckens for a floating frame"
        )
    drag = float(np.trace(system.D[:count, :count]) / np.trace(system.M[:count, :count]))
    beyond = system.D[:count] - drag * system.M[:count]  # alpha M damps rigid motion too
    size = max(np.abs(system.D).max(), 1e-300)
    held = any(
        np.abs(T[:count]).max() > 1e-6 * max(np.abs(T).max(), 1e-300)
        for T in (system.S, *(term.matrix for term in system.terms))
    )
    if held or np.abs(beyond).max() > 1e-6 * size:
        raise BodyError(
            "dampers act on the rigid motion of the body; a floating frame keeps "
            "only the damping of its deformation: put them into the multibody "
            "model instead"
        )
    return rom.with_parts(
        system=system.without_first(count),
        basis=rom.basis.without_first(count),
        frame=rom.frame.without_rigid_modes(),
        modes=rom.modes[count:],
    )


def without_rigid_modes(rom: Body) -> Body:
    """``ReducedModel.without_rigid_modes``."""
    count, system = rom.frame.rigid_modes, rom.system
    if count == 0:
        return rom
    squares, modes = natural_modes(system.K, system.M)
    modes = modes[:, np.argsort(np.abs(squares), kind="stable")]
    for damping in (system.D, system.S, *(term.matrix for term in system.terms)):
        D = modes.T @ damping @ modes
        own = np.sqrt(np.abs(np.diag(D)))
        allowed = 1e-6 * np.outer(own, own) + 1e-12 * np.abs(D).max(initial=0)
        if np.any(np.abs(D)[count:, :count] > allowed[count:, :count]):
            raise BodyError(
                "dampers act on the rigid motion of the body: its elastic motion is none by itself"
            )
    Q = modes[:, count:]
    return rom.with_parts(
        system=system.projected(Q),
        basis=rom.basis.projected(Q),
        frame=Frame(),
        modes=rom.modes[count:],
    )
