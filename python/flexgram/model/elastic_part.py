"""What is left of a free reduced body without its rigid motion: in its own frame, for a floating
frame of reference, and without its rigid modes, for the elastic part of H.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import scipy.linalg

from flexgram.basics import BodyError
from flexgram.model.reduced import ReducedBody

Body = TypeVar("Body", bound=ReducedBody)


def in_its_frame(rom: Body) -> Body:
    """``ReducedBody.elastic``."""
    count = rom.frame["rigid_modes"]
    if count == 0:
        return rom
    if rom.frame["kind"] == "none":
        raise BodyError("the basis mixes rigid with elastic motion (-mor_frame none or "
                        "-mor_method pod): reduce with -mor_method two_step and -mor_frame "
                        "buckens for a floating frame")  # fmt: skip
    drag = float(np.trace(rom.D[:count, :count]) / np.trace(rom.M[:count, :count]))
    beyond = rom.D[:count] - drag * rom.M[:count]  # alpha M damps rigid motion too
    if np.abs(beyond).max() > 1e-6 * max(np.abs(rom.D).max(), 1e-300):
        raise BodyError("dampers act on the rigid motion of the body; a floating frame keeps "
                        "only the damping of its deformation: put them into the multibody "
                        "model instead")  # fmt: skip
    keep = slice(count, None)
    frame = dict(rom.frame)
    if "M_er" in frame:
        frame["M_er"] = frame["M_er"][keep]
        frame["gyroscopic"] = frame["gyroscopic"][keep, :, keep]
        frame["inertia_first"] = frame["inertia_first"][:, :, keep]
        frame["inertia_second"] = frame["inertia_second"][:, keep, :, keep]
    frame["rigid_modes"] = 0
    return rom.replaced(
        M=rom.M[keep, keep],
        D=rom.D[keep, keep],
        K=rom.K[keep, keep],
        B=rom.B[keep],
        C=rom.C[:, keep],
        V=rom.V[:, keep] if rom.V.ndim == 2 else rom.V,  # else loaded without
        frame=frame,
        modes=rom.modes[keep],
    )


def without_rigid_modes(rom: Body) -> Body:
    """``ReducedBody.without_rigid_modes``."""
    count = rom.frame["rigid_modes"]
    if count == 0:
        return rom
    squares, modes = scipy.linalg.eigh(rom.K, rom.M)
    modes = modes[:, np.argsort(np.abs(squares), kind="stable")]
    D = modes.T @ rom.D @ modes
    own = np.sqrt(np.abs(np.diag(D)))
    allowed = 1e-6 * np.outer(own, own) + 1e-12 * np.abs(D).max(initial=0)
    if np.any(np.abs(D)[count:, :count] > allowed[count:, :count]):
        raise BodyError("dampers act on the rigid motion of the body: its elastic motion is "
                        "none by itself")  # fmt: skip
    Q = modes[:, count:]
    return rom.replaced(
        M=Q.T @ rom.M @ Q,
        D=Q.T @ rom.D @ Q,
        K=Q.T @ rom.K @ Q,
        B=Q.T @ rom.B,
        C=rom.C @ Q,
        V=rom.V @ Q if rom.V.ndim == 2 else rom.V,
        frame={"kind": "none", "rigid_modes": 0},
        modes=rom.modes[count:],
    )
