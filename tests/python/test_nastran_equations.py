"""Equations of Nastran bulk data: MPC, supports in axes of a grid's own, RBE2 of some components,
RBE3 at a grid of an element. Against the same written out, and against closed forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as sl
from test_nastran_bulk import plate

from conftest import assembled
from flexgram.importers import parse
from flexgram.importers.nastran_bulk import assemble_bulk


def matrices(folder: Path, text: str, ranks: int = 1) -> dict[str, Any]:
    (folder / "p.bdf").write_text(text)
    facts = assemble_bulk(folder / "p.bdf", folder / "p.h5", [parse("node", "tip=NODES:70")])
    a = assembled(folder / "m.h5", folder / "p.h5", ranks)
    order = np.lexsort((a["component"], a["node"]))
    for name in ("K", "M"):
        a[name] = a[name].toarray()[np.ix_(order, order)]
    for name in ("node", "component", "position"):
        a[name] = a[name][order]
    a["remarks"] = facts["remarks"]
    return a


def equal(a: dict[str, Any], b: dict[str, Any]) -> None:
    for name in ("K", "M"):
        assert a[name].shape == b[name].shape
        np.testing.assert_allclose(a[name], b[name], atol=1e-11 * abs(b[name]).max())


def rows_of(a: dict[str, Any], label: int) -> list[int]:
    """Of grid 10, 20, … by component."""
    at = a["node"] == label // 10 - 1
    return [int(np.flatnonzero(at & (a["component"] == c))[0]) for c in range(6)]


def taken_out(a: dict[str, Any], E: Any, dependent: list[int]) -> dict[str, Any]:
    """K and M with E u = 0, each row of which takes out a dof."""
    kept = np.setdiff1d(np.arange(len(a["K"])), dependent)
    T = np.zeros((len(a["K"]), len(kept)))
    T[kept, np.arange(len(kept))] = 1
    T[dependent] = -np.linalg.solve(E[:, dependent], E[:, kept])
    return {name: T.T @ a[name] @ T for name in ("K", "M")}


@pytest.mark.parametrize("ranks", [1, 2])
def test_mpc(ranks: int, tmp_path: Path) -> None:
    """Of the first subcase, by MPCADD; in axes of the second grid's own (CD, 30° about z)."""
    plain = matrices(tmp_path, plate())
    cards = (
        "MPCADD,7,5,6\nMPC,5,50,1,2.0,80,2,-1.\nMPC,6,60,3,1.0,90,5,0.3\nMPC,8,50,2,1.,60,2,1.\n"
    )
    turned = "CORD2R,9,,0.,0.,0.,0.,0.,1.\n,0.8660254037844387,0.5,0.\n"
    a = matrices(
        tmp_path,
        with_cd(plate(cards + turned), 80).replace("BEGIN BULK", "MPC = 7\nBEGIN BULK"),
        ranks,
    )
    E = np.zeros((2, len(plain["K"])))
    E[0, rows_of(plain, 50)[0]] = 2.0
    E[0, rows_of(plain, 80)[:2]] = [0.5, -np.sqrt(0.75)]  # -(-sin, cos)
    E[1, rows_of(plain, 60)[2]], E[1, rows_of(plain, 90)[4]] = 1.0, 0.3
    equal(a, taken_out(plain, E, [rows_of(plain, 50)[0], rows_of(plain, 60)[2]]))


def with_cd(text: str, label: int) -> str:
    """A grid with displacements along axes of system 9."""
    out = []
    for line in text.splitlines():
        words = [word.strip() for word in line.split(",")]
        if words[:2] == ["GRID", str(label)]:
            words = [*words, "9"]
            assert len(words) == 7
            line = ",".join(words)
        out.append(line)
    return "\n".join(out) + "\n"


@pytest.mark.parametrize(
    ("system", "outward"),
    [
        ("CORD2R,9,,0.,0.,0.,0.,0.,1.\n,0.6,0.8,0.\n", (0.6, 0.8, 0.0)),
        # About (0, 1, 0): the grid 90 at (1, 1, 0) lies along x.
        ("CORD2C,9,,0.,1.,0.,0.,1.,1.\n,0.,2.,0.\n", (1.0, 0.0, 0.0)),
        ("CORD2S,9,,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n", (np.sqrt(0.5), np.sqrt(0.5), 0.0)),
    ],
    ids=["rectangular", "cylindrical", "spherical"],
)
def test_a_support_along_axes_of_the_grid(
    system: str, outward: tuple[float, ...], tmp_path: Path
) -> None:
    plain = matrices(tmp_path, plate())
    a = matrices(tmp_path, with_cd(plate("SPC1,1,1,90\n" + system), 90))
    E = np.zeros((1, len(plain["K"])))
    E[0, rows_of(plain, 90)[:3]] = outward
    dependent = rows_of(plain, 90)[int(np.argmax(np.abs(outward)))]
    ours, theirs = (
        sl.eigh(m["K"], m["M"], eigvals_only=True) for m in (a, taken_out(plain, E, [dependent]))
    )
    np.testing.assert_allclose(ours, theirs, rtol=1e-7)


@pytest.mark.parametrize(("kind", "coupled"), [("RBE2", "123"), ("RBE2", "35"), ("RBAR", "123")])
def test_rigid_elements_of_some_components(kind: str, coupled: str, tmp_path: Path) -> None:
    """Grid 80 moves 90 but for what is left free."""
    rigid = (
        f"RBE2,92,80,{coupled},90\n" if kind == "RBE2" else f"RBAR,92,80,90,123456,,,{coupled}\n"
    )
    plain, a = matrices(tmp_path, plate()), matrices(tmp_path, plate(rigid))
    one, other = rows_of(plain, 80), rows_of(plain, 90)
    arm = plain["position"][other[0]] - plain["position"][one[0]]
    E = np.zeros((len(coupled), len(plain["K"])))
    for row, c in zip(E, (int(c) - 1 for c in coupled), strict=True):
        row[other[c]], row[one[c]] = 1.0, -1.0
        if c < 3:
            row[one[3:]] = -np.cross(np.eye(3), arm)[:, c]
    equal(a, taken_out(plain, E, [other[int(c) - 1] for c in coupled]))


def test_rbe3_at_a_grid_of_an_element(tmp_path: Path) -> None:
    """Grid 50 is the weighted mean of three others: a rigid motion of these moves it along."""
    text = "RBE3,92,,50,123456,1.0,123,70,80,+\n+,2.5,123,60\n"
    plain, a = matrices(tmp_path, plate()), matrices(tmp_path, plate(text))
    weights = {70: 1.0, 80: 1.0, 60: 2.5}
    middle = plain["position"][rows_of(plain, 50)[0]]
    normal, right = np.zeros((6, 6)), np.zeros((6, len(plain["K"])))
    for label, weight in weights.items():
        at = rows_of(plain, label)
        G = np.hstack([np.eye(3), np.cross(np.eye(3), plain["position"][at[0]] - middle).T])
        normal += weight * G.T @ G
        right[:, at[:3]] += weight * G.T
    E = -np.linalg.solve(normal, right)
    E[np.arange(6), rows_of(plain, 50)] += 1
    equal(a, taken_out(plain, E, rows_of(plain, 50)))
