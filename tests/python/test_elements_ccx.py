"""Eigenfrequencies of every element type against CalculiX (scripts/ccx_reference.py).

CalculiX integrates the mass of C3D4, C3D10 and C3D15 with the points of the stiffness;
``mass_integration: reduced`` does the same, and then both programs agree to the seven digits
that CalculiX prints. With the full rule they differ by the error of that integration.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from bodies import CALCULIX, box, write_body_file
from conftest import assembled

REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "ccx.json").read_text())
SPREAD = {"end": {"set": "end", "coupling": "distributing"}}


def deviation(case: dict[str, Any], folder: Path, mass: str, ranks: int = 1) -> Any:
    """Relative differences of the first ten eigenfrequencies."""
    mesh = box(CALCULIX[case["element"]], tuple(case["counts"]), distort=case["distort"])
    body = folder / "body.h5"
    write_body_file(body, mesh, interfaces=SPREAD, supports={"start": [0, 1, 2]}, mass=mass)
    a = assembled(folder / "matrices.h5", body, ranks)
    squares = eigsh(a["K"], 10, a["M"], sigma=0, return_eigenvectors=False)
    return np.sqrt(np.sort(squares)) / (2 * np.pi) / np.array(case["frequencies"]) - 1


def cases(*elements: str) -> list[Any]:
    chosen = [case for case in REFERENCE["boxes"] if case["element"] in elements]
    label = "{element}-{counts[0]}-{distort}"
    return [pytest.param(case, id=label.format(**case)) for case in chosen]


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("case", cases("C3D4", "C3D10", "C3D15", "C3D20"))
def test_equal_formulations_agree_to_printed_digits(
    case: dict[str, Any], ranks: int, tmp_path: Path
) -> None:
    # Seven digits printed: half a unit in the seventh is at most 5e-7.
    assert np.abs(deviation(case, tmp_path, "reduced", ranks)).max() < 5.5e-7


def pair(element: str) -> tuple[dict[str, Any], dict[str, Any]]:
    distorted = [c for c in REFERENCE["boxes"] if c["element"] == element and c["distort"]]
    coarse, fine = sorted(distorted, key=lambda case: case["counts"])
    return coarse, fine


@pytest.mark.parametrize(
    ("element", "order"), [("C3D4", 2), ("C3D10", 4), ("C3D15", 4), ("C3D8I", 2), ("C3D20R", 2)]
)
def test_other_formulations_converge_to_each_other(
    element: str, order: int, tmp_path: Path
) -> None:
    """Full against under-integrated mass (quadratic elements h^4), reduced integration of C3D20R,
    inertia of the incompatible modes of C3D8I: the difference must vanish as h^order. A halved h
    and modes of a few elements a wave cost up to half an order."""
    coarse, fine = (np.abs(deviation(case, tmp_path, "full")).max() for case in pair(element))
    assert fine < coarse / 2 ** (order - 0.5)


def test_incompatible_modes_are_those_of_calculix(tmp_path: Path) -> None:
    """One rectangular C3D8I: CalculiX keeps the incompatible modes as dofs with mass; condensed
    statically in K and M its matrices are ours. (On distorted elements CalculiX does not take the
    gradients of these modes at the centre, which the patch test needs; K differs by 6e-4 there.)"""
    data = REFERENCE["one_element"]
    full = {}
    for key in ("K", "M"):
        upper = np.zeros((33, 33))
        upper.T[np.tril_indices(33)] = data[key]
        full[key] = upper + np.triu(upper, 1).T
    K = full["K"]
    T = np.vstack([np.eye(24), -np.linalg.solve(K[24:, 24:], K[24:, :24])])
    mesh = box("hexahedron", (1, 1, 1), (0.02, 0.01, 0.015), distort=False)
    write_body_file(tmp_path / "body.h5", mesh, interfaces=SPREAD, mass="reduced")
    ours = assembled(tmp_path / "matrices.h5", tmp_path / "body.h5")
    order = np.argsort(3 * ours["node"] + ours["component"])
    for key in ("K", "M"):
        expected = T.T @ full[key] @ T
        found = ours[key].toarray()[np.ix_(order, order)]
        assert np.abs(found - expected).max() < 1e-11 * np.abs(expected).max()
