"""Membranes: the patch test, a drum under tension, a wing whose frequencies are published."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from conftest import assembled
from flexgram.body.description import import_description
from flexgram.importers import parse
from flexgram.importers.nastran_bulk import assemble_bulk

E_, NU, RHO, T = 2e9, 0.3, 1200.0, 0.004
LAW = {"m": {"E": E_, "nu": NU, "rho": RHO}}


def described(nodes: Any, **more: Any) -> dict[str, Any]:
    return {
        "materials": LAW,
        "sections": {"skin": {"shape": "shell", "thickness": T}},
        "regions": {"all": {"material": "m", "section": "skin", "formulation": "membrane"}},
        "interfaces": {"a": {"nodes": nodes, "coupling": "node"}},
    } | more


def sheet(kind: str, cells: int, size: float, distort: bool = True) -> meshio.Mesh:
    """A square in the plane z = 0, with oblique elements."""
    u, v = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    bulge = 0.12 * np.sin(np.pi * u) * np.sin(np.pi * v) if distort else 0 * u
    points = size * np.stack([u + bulge, v - 0.7 * bulge, 0 * u], axis=-1).reshape(-1, 3)
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    if kind == "quad":
        return meshio.Mesh(points, [("quad", quads)])
    return meshio.Mesh(points, [("triangle", np.vstack([quads[:, :3], quads[:, [0, 2, 3]]]))])


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_patch(kind: str, ranks: int, tmp_path: Path) -> None:
    """Of linear displacements in the plane: no force inside, and the energy of plane stress; three
    dofs a node, nothing across."""
    mesh = sheet(kind, 3, 0.5)
    import_description(described([1]), "patch", tmp_path / "b.h5", mesh=mesh)
    a = assembled(tmp_path / "a.h5", tmp_path / "b.h5", ranks)
    K, x = a["K"].toarray(), a["position"]
    assert len(K) == 3 * len(mesh.points)
    slopes = np.array([[2e-4, -1e-4], [3e-4, 1.5e-4]])
    u = np.where(a["component"] == 0, x[:, :2] @ slopes[0], 0.0)
    u = np.where(a["component"] == 1, x[:, :2] @ slopes[1], u)
    forces = K @ u
    edge = (np.abs(x[:, :2]) < 1e-9).any(axis=1) | (np.abs(x[:, :2] - 0.5) < 1e-9).any(axis=1)
    assert np.abs(forces[~edge]).max() < 1e-11 * np.abs(forces).max()
    strain = np.array([slopes[0, 0], slopes[1, 1], slopes[0, 1] + slopes[1, 0]])
    law = E_ / (1 - NU**2) * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, (1 - NU) / 2]])
    assert u @ forces == pytest.approx(0.25 * T * strain @ law @ strain, rel=1e-12)
    across = a["component"] == 2
    assert np.abs(K[across]).max() == 0
    total = a["M"].toarray()[np.ix_(across, across)].sum()
    assert total == pytest.approx(0.25 * T * RHO, rel=1e-12)


def test_a_drum(tmp_path: Path) -> None:
    """A square under even tension, held at its edge: ω = π √(S (i² + j²) / ρ t) / L."""
    L, pull = 0.5, 8e3  # N/m
    mesh = sheet("quad", 16, L, distort=False)
    x = mesh.points
    sides = {"left": x[:, 0] < 1e-9, "right": x[:, 0] > L - 1e-9,
             "low": x[:, 1] < 1e-9, "high": x[:, 1] > L - 1e-9}  # fmt: skip
    corner = np.sum(list(sides.values()), axis=0) > 1
    table = []
    for name, component in (("right", 0), ("high", 1)):
        for node in np.flatnonzero(sides[name]):
            row = [int(node) + 1, 0.0, 0.0, 0.0]
            row[1 + component] = pull * L / 16 * (0.5 if corner[node] else 1.0)
            table.append(row)
    edge = np.flatnonzero(np.any(list(sides.values()), axis=0)) + 1
    content = described(
        [int(np.argmin(np.linalg.norm(x - [L / 2, L / 2, 0], axis=1))) + 1],
        supports={
            "across": {"nodes": [int(n) for n in edge], "components": ["z"]},
            "left": {"nodes": [int(n) + 1 for n in np.flatnonzero(sides["left"])],
                     "components": ["x"]},
            "low": {"nodes": [int(n) + 1 for n in np.flatnonzero(sides["low"])],
                    "components": ["y"]},
        },
        springs={"soft": {"nodes": list(range(1, len(x) + 1)), "stiffness": [0, 0, 1e-3]}},
        loads={"pull": {"type": "nodal", "table": table}},
        preload={"pull.load": 1.0},
    )  # fmt: skip
    import_description(content, "drum", tmp_path / "b.h5", mesh=mesh)
    a = assembled(tmp_path / "a.h5", tmp_path / "b.h5")
    across = np.flatnonzero(a["component"] == 2)
    K, M = (a[k].tocsr()[across][:, across] for k in ("K", "M"))
    omega = np.sqrt(np.sort(eigsh(K, 3, M, sigma=0, return_eigenvectors=False)))
    exact = np.pi / L * np.sqrt(pull / (RHO * T) * np.array([2, 5, 5]))
    np.testing.assert_allclose(omega, exact, rtol=0.015)


def wing() -> str:
    """The wing of Goland (1945) as a box of membranes and rods, after Eastep and Olsen (1980) and
    Beran et al. (2004), in slugs and feet: spars at x = 0, 2, 4, ribs every two feet."""
    at = {(i, j, k): 1 + 6 * j + 3 * k + i for j in range(11) for k in (0, 1) for i in range(3)}
    text = "".join(
        f"GRID,{n},,{2.0 * i},{2.0 * j},{(-1) ** k * 0.166667}\n" for (i, j, k), n in at.items()
    )
    sections = [0.0155, 0.0006, 0.0889, 0.0347]  # skin, outer spars, middle spar, ribs
    areas = [0.0008, 0.0422, 0.0416, 0.1492]  # posts, caps of ribs, of outer and middle spars
    text += "".join(f"PSHELL,{p},1,{t}\n" for p, t in enumerate(sections, 1))
    text += "".join(f"PROD,{p},1,{A}\n" for p, A in enumerate(areas, 11))
    number = 0

    def add(card: str, prop: int, *places: tuple[int, int, int]) -> None:
        nonlocal text, number
        number += 1
        text += f"{card},{number},{prop},{','.join(str(at[p]) for p in places)}\n"

    for j in range(11):
        for i in range(3):
            add("CROD", 11, (i, j, 0), (i, j, 1))
            if j == 10:
                continue
            middle = i == 1
            add("CQUAD4", 3 if middle else 2, (i, j, 0), (i, j + 1, 0), (i, j + 1, 1), (i, j, 1))
            for k in (0, 1):
                add("CROD", 14 if middle else 13, (i, j, k), (i, j + 1, k))
        for i in (0, 1):
            add("CQUAD4", 4, (i, j, 0), (i + 1, j, 0), (i + 1, j, 1), (i, j, 1))
            for k in (0, 1):
                first = 0 if (i, j, k) == (1, 5, 0) else i  # in that model it passes a grid by
                add("CROD", 12, (first, j, k), (i + 1, j, k))
                if j < 10:
                    add("CQUAD4", 1, (i, j, k), (i + 1, j, k), (i + 1, j + 1, k), (i, j + 1, k))
        for i, mass in enumerate((1.965, 3.9442, 5.3398)):
            for k in (0, 1):
                number += 1
                share = mass / 2 if j in (0, 10) else mass
                text += f"CONM2,{number},{at[i, j, k]},,{share}\n"
    held = ",".join(str(at[i, 0, k]) for i in range(3) for k in (0, 1))
    return (
        "SOL 103\nCEND\nSPC = 8\nBEGIN BULK\nMAT1,1,1.4976+9,,.3333333,.0001\n"
        f"SPC1,8,123456,{held}\n{text}ENDDATA\n"
    )


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_wing(ranks: int, tmp_path: Path) -> None:
    """Its first frequency is that which Nastran prints of this box (pyNastran's model
    goland_final_test), to its digits; the others are near the published ones."""
    (tmp_path / "w.bdf").write_text(wing())
    tip = [parse("node", "tip=NODES:61")]
    facts = assemble_bulk(tmp_path / "w.bdf", tmp_path / "w.h5", tip)
    assert any("is a membrane" in remark for remark in facts["remarks"])
    a = assembled(tmp_path / "a.h5", tmp_path / "w.h5", ranks)
    assert a["K"].shape == (180, 180)
    squares = np.sort(eigsh(a["K"], 4, a["M"], sigma=0, return_eigenvectors=False))
    hz = np.sqrt(squares) / (2 * np.pi)
    assert hz[0] == pytest.approx(1.981382, abs=1e-6)
    np.testing.assert_allclose(hz, [1.97, 4.05, 9.65, 13.4], rtol=0.012)


def test_what_is_refused(tmp_path: Path) -> None:
    mesh = sheet("quad", 2, 1.0)
    content = described([1], sections={"skin": {"shape": "shell", "thickness": T, "offset": 0.1}})
    import_description(content, "b", tmp_path / "b.h5", mesh=mesh)
    with pytest.raises(AssertionError, match="a membrane has no offset"):
        assembled(tmp_path / "a.h5", tmp_path / "b.h5")
