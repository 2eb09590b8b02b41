"""Nastran DMIG: KRED, MRED, BRED on scalar points 1 … m, and PRED, the load of each input."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexgram.basics import BodyError, Floats, written_aside
from flexgram.model.modes import natural_modes
from flexgram.model.reduced import ReducedBody


def number(value: float) -> str:
    """Sixteen characters of a number with D exponent.

    Examples
    --------
    >>> number(-0.1)
    '-1.0000000000D-1'
    """
    mantissa, exponent = f"{value:.16E}".split("E")
    exponent = f"{'-' if exponent[0] == '-' else '+'}{abs(int(exponent))}"
    for digits in range(16, 5, -1):  # as many digits as fit
        text = f"{float(mantissa):.{digits}f}D{exponent}"
        if len(text) <= 16:
            return text
    return text


def matrix_cards(
    name: str, a: Floats, symmetric: bool, dofs: Sequence[tuple[int, int]] = ()
) -> list[str]:
    """DMIG cards of a matrix whose rows (and columns, if symmetric) are dofs: points and their
    components, 0 of scalar points; default: scalar points from 1.

    Examples
    --------
    >>> cards = matrix_cards("KRED", np.array([[2.0, 0], [0, 3.0]]), symmetric=True)
    >>> cards[0].split()
    ['DMIG', 'KRED', '0', '6', '2', '0', '2']
    """
    form = 6 if symmetric else 9
    rows_of = dofs or [(i + 1, 0) for i in range(len(a))]
    columns_of = rows_of if symmetric else [(j + 1, 0) for j in range(a.shape[1])]
    lines = [f"{'DMIG':<8}{name:<8}{0:>8}{form:>8}{2:>8}{0:>8}{'':8}{'':8}{a.shape[1]:>8}"]
    for j in range(a.shape[1]):
        rows = [i for i in range(j + 1 if symmetric else a.shape[0]) if a[i, j] != 0]
        if not rows:
            continue
        point, component = columns_of[j]
        lines.append(f"{'DMIG*':<8}{name:<16}{point:>16}{component:>16}{'':16}*")
        for i in rows:
            point, component = rows_of[i]
            lines.append(f"{'*':<8}{point:>16}{component:>16}{number(a[i, j]):>16}")
    return lines


def write_dmig(model: ReducedBody, path: Path) -> None:
    """Write the punch file; unit: N, m, kg, s.

    The scalar points are the modal coordinates of the reduced body: sixteen columns hold eleven or
    twelve digits, and only a diagonal stiffness keeps them all for every mode.

    Examples
    --------
    >>> write_dmig(flexgram.ReducedModel.load("rack.rom.h5"), Path("rack.pch"))
    """
    model.system.expect_symmetric("this file")
    if model.system.loss:
        raise BodyError(
            f"structural damping ({model.system.loss}) has no matrix in this file: "
            "export it with --damping modal or rayleigh (eta alone goes into Nastran by PARAM,G)"
        )
    error = f"error {model.claim.supremum:.1e} ({model.claim.label})"
    lines = [f"$ flexgram: {model.order} generalised coordinates, {error}"]
    lines += [f"$ column {j + 1} of PRED: {name}" for j, name in enumerate(model.inputs)]
    values, modes = natural_modes(model.system.K, model.system.M)
    if not np.all(np.isfinite(values)):
        raise BodyError(
            f"{int(np.isinf(values).sum())} of the coordinates have no mass, and modal ones need "
            "it: condense them before the reduction, or export op4 or nastran"
        )
    values[: model.frame.rigid_modes] = 0
    D = modes.T @ model.system.D @ modes
    D[np.abs(D) < 1e-15 * np.abs(D).max(initial=0)] = 0
    lines += [f"{'SPOINT':<8}{1:>8}{'THRU':<8}{model.order:>8}"]
    lines += matrix_cards("KRED", np.diag(values), True)
    lines += matrix_cards("MRED", np.eye(model.order), True)
    if np.any(D):
        lines += matrix_cards("BRED", 0.5 * (D + D.T), True)
    lines += matrix_cards("PRED", modes.T @ model.system.B, False)
    with written_aside(path) as place:
        place.write_text("\n".join(lines) + "\n")
