"""MBDyn: the data file of a modal joint, with the interfaces as its nodes.

Records as in the appendix "Modal Element Data" of MBDyn's input manual. MBDyn makes the coupling of
rigid and elastic motion of lumped masses at the nodes of the file; a reduced body has none. In mean
axes that coupling is zero, and what is left out is of second order in the deformation.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, written_aside
from flexgram.model.elastic_part import expect_one_body, in_its_frame
from flexgram.model.geometry import interface_motion, interface_positions
from flexgram.model.physical import physical_form
from flexgram.model.reduced import ReducedBody


def _numbers(a: ArrayLike) -> list[str]:
    """Six to a line, as the format asks for."""
    flat = np.asarray(a, dtype=float).ravel()
    return ["".join(f"{x:25.16e}" for x in flat[k : k + 6]) for k in range(0, len(flat), 6)]


def write_mbdyn(model: ReducedBody, path: Path, body: str | Path | None = None) -> None:
    """Nodes are the interfaces, by their names, in the axes of the body.

    A free body moves with MBDyn's modal node, which carries those axes; a held one is ``clamped``.
    The joint takes its damping by ``damping from file``.

    Parameters
    ----------
    model : ReducedBody
        Free, in mean axes (``--frame buckens``), or held.
    path : Path
        ``.fem`` file.
    body : str or Path, optional
        Body file, where the interfaces of a held body are.

    Raises
    ------
    BodyError
        For structural damping, other frames, and bodies without interfaces of six ports.
    """
    if model.system.loss:
        raise BodyError(
            f"MBDyn has no structural damping ({model.system.loss}): give Rayleigh damping, or "
            "export with --damping modal or rayleigh"
        )
    expect_one_body(model, "MBDyn's modal joint")
    frame = model.frame
    free = frame.rigid_modes > 0
    if free and (frame.rigid_modes != 6 or frame.kind != "buckens"):
        raise BodyError(
            "MBDyn's modal joint couples rigid and elastic motion of nodes with masses "
            "only, which a reduced body does not have: reduce a free body by "
            "--frame buckens, in whose mean axes nothing is to couple"
        )
    elastic = in_its_frame(model) if free else model
    motion = interface_motion(elastic)
    if not motion:
        raise BodyError("no interface of six ports, fx to mz: MBDyn's nodes would be none")
    names = [name.replace(" ", "_") for name in motion]
    places = interface_positions(model) if free else physical_form(model).positions(body)
    points = np.array([places[name] for name in motion])
    m = elastic.order
    shapes = np.array([np.vstack(motion[name]).T for name in motion])  # (nodes, m, 6)

    def record(number: int, title: str, lines: list[str]) -> list[str]:
        return [f"** RECORD GROUP {number}, {title}", *lines, "**"]

    lines = [f"** flexgram: {model.claim.words}", "**"]
    lines += record(
        1,
        "HEADER",
        [
            "**   REVISION,  NODE,  NORMAL, ATTACHMENT, CONSTRAINT, REJECTED",
            f"  REV0 {len(names)} {m} 0 0 0",
        ],
    )
    lines += record(2, "FINITE ELEMENT NODE LIST", [" ".join(names)])
    for number, axis in ((5, "X"), (6, "Y"), (7, "Z")):
        lines += record(number, f"NODAL {axis} COORDINATES", _numbers(points[:, number - 5]))
    modes = []
    for k in range(m):
        modes.append(f"**    NORMAL MODE SHAPE #  {k + 1}")
        modes += [line for shape in shapes[:, k] for line in _numbers(shape)]
    lines += record(8, "NON-ORTHOGONALIZED MODE SHAPES", modes)
    lines += record(9, "MODAL MASS MATRIX", _numbers(elastic.system.M))
    lines += record(10, "MODAL STIFFNESS MATRIX", _numbers(elastic.system.K))
    if frame.integrals:
        mass, centre = frame.integrals.mass, frame.integrals.centre
        about_origin = frame.integrals.M_r[3:, 3:]
        inertia = about_origin - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        lines += record(
            12,
            "GLOBAL INERTIA PROPERTIES",
            [*_numbers(mass), *_numbers(centre), *(_numbers(row)[0] for row in inertia)],
        )
    lines += record(13, "MODAL DAMPING MATRIX", _numbers(elastic.system.D))
    lines.append("** END OF FILE")
    with written_aside(path) as place:
        place.write_text("\n".join(lines) + "\n")
