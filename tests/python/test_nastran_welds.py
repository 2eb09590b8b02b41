"""Spot welds between two sheets: the stiffness between them, by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import assembled
from flexgram.basics import BodyError
from flexgram.importers import parse
from flexgram.importers.nastran_bulk import assemble_bulk

GAP = 0.004
FAST = "CFAST,90,9,PROP,1,2,300\nPFAST,9,0.006,,,3.+7,1.+7,1.+7,40.\n,25.,25.,0.02,0.03\n"
WELD = "CWELD,90,9,300,PARTPAT\n,1,2\nPWELD,9,1,0.006\n"
E_, G_ = 2.1e11, 2.1e11 / 2.6


def deck(weld: str, held: bool = True, kind: str = "CQUAD4") -> str:
    """Two sheets of 0.1 × 0.06, the upper one shifted, a grid of a weld between them."""
    lines = ["SOL 103\nCEND\nSPC = 1\nBEGIN BULK\nPARAM,COUPMASS,1\n"]
    upper = []
    for sheet in (0, 1):
        for j in range(4):
            for i in range(5):
                n = 100 * sheet + 10 * j + i + 1
                x, y = 0.025 * i + 0.013 * sheet, 0.02 * j
                lines.append(f"GRID,{n},,{x:.6f},{y:.6f},{GAP * sheet}\n")
                upper += [n] if sheet else []
        for j in range(3):
            for i in range(4):
                n = 100 * sheet + 10 * j + i + 1
                e = 1000 * (sheet + 1) + 20 * j + 2 * i
                if kind == "CQUAD4":
                    lines.append(f"CQUAD4,{e},{sheet + 1},{n},{n + 1},{n + 11},{n + 10}\n")
                else:
                    lines.append(f"CTRIA3,{e},{sheet + 1},{n},{n + 1},{n + 11}\n")
                    lines.append(f"CTRIA3,{e + 1},{sheet + 1},{n},{n + 11},{n + 10}\n")
    lines.append("PSHELL,1,1,0.001,1,,1\nPSHELL,2,1,0.001,1,,1\nMAT1,1,2.1+11,,0.3,7850.,,,\n,,,\n")
    lines.append(f"GRID,300,,0.0613,0.0277,{GAP / 2}\n" + weld)
    if held:
        lower = [f"SPC1,1,123456,{10 * j + 1},THRU,{10 * j + 5}\n" for j in range(4)]
        lines += lower
        rows = [upper[k : k + 8] for k in range(5, len(upper), 8)]
        first = ",".join(map(str, upper[:5]))
        rest = "".join(",".join(["", *map(str, row)]) + "\n" for row in rows)
        lines.append(f"GRID,500,,0.08,0.05,0.03\nRBE2,95,500,123456,{first}\n{rest}")
    text = "".join(lines) + "ENDDATA\n"
    return text if held else text.replace("SPC = 1\n", "")


def joined(folder: Path, text: str, ranks: int = 1) -> dict[str, Any]:
    (folder / "w.bdf").write_text(text)
    ports = [] if "RBE2" in text else [parse("node", "tip=NODES:135")]
    facts = assemble_bulk(folder / "w.bdf", folder / "w.h5", ports)
    return assembled(folder / "a.h5", folder / "w.h5", ranks) | {"facts": facts}


def expected(stiffness: Any) -> Any:
    """Between a sheet that is held and a rigid one: about the reference at (0.08, 0.05, 0.03)."""
    arm = np.array([0.0613, 0.0277, GAP / 2]) - [0.08, 0.05, 0.03]
    carried = np.eye(6)
    carried[:3, 3:] = np.column_stack([np.cross(e, arm) for e in np.eye(3)])
    along = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0.0]])  # the weld's x is the global z
    axes = np.kron(np.eye(2), along)
    return carried.T @ axes.T @ np.diag(stiffness) @ axes @ carried


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", ["CQUAD4", "CTRIA3"])
def test_a_fastener(kind: str, ranks: int, tmp_path: Path) -> None:
    a = joined(tmp_path, deck(FAST, kind=kind), ranks)
    K = a["K"].toarray()
    assert K.shape == (6, 6)
    np.testing.assert_allclose(
        K, expected([3e7, 1e7, 1e7, 40, 25, 25]), atol=1e-9 * np.abs(K).max()
    )
    total = a["M"].toarray()[:3, :3].trace() / 3
    assert total == pytest.approx(7850 * 0.1 * 0.06 * 0.001 + 0.01, rel=1e-9)  # half of 0.02 kg


@pytest.mark.parametrize(
    "form",
    [
        "PARTPAT\n,1,2",
        "ELPAT\n,1024,2022",
        "ELEMID,,,,,+\n+,1024,2022",
        "GRIDID,,,QQ\n,13,14,24,23,,,,\n,112,113,123,122",
        "GRIDID,,,QT\n,13,14,24,23,,,,\n,112,113,123",
    ],
)
def test_a_weld(form: str, tmp_path: Path) -> None:
    """A short round beam, whose length is no less than a fifth of its diameter."""
    for diameter in (0.006, 0.03):
        text = WELD.replace("PARTPAT\n,1,2", form).replace("0.006", str(diameter))
        K = joined(tmp_path, deck(text))["K"].toarray()
        L = max(GAP, 0.2 * diameter)
        A, J = np.pi * diameter**2 / 4, np.pi * diameter**4 / 64
        across = 1 / (L**3 / (12 * E_ * J) + L / (0.9 * G_ * A))
        by_hand = [E_ * A / L, across, across, 2 * G_ * J / L, E_ * J / L, E_ * J / L]
        np.testing.assert_allclose(K, expected(by_hand), atol=1e-6 * np.abs(K).max())


def test_a_weld_between_grids(tmp_path: Path) -> None:
    """ALIGN: a round beam between two grids of the sheets, whatever its direction."""
    text = WELD.replace("300,PARTPAT\n,1,2", ",ALIGN,13,112")
    K = joined(tmp_path, deck(text))["K"].toarray()
    ends = np.array([[0.05, 0.02, 0.0], [0.038, 0.02, GAP]])
    L, x = np.linalg.norm(ends[1] - ends[0]), ends[1] - ends[0]
    A, J = np.pi * 0.006**2 / 4, np.pi * 0.006**4 / 64
    across = 1 / (L**3 / (12 * E_ * J) + L / (0.9 * G_ * A))
    own = np.diag([E_ * A / L, across, across, 2 * G_ * J / L, E_ * J / L, E_ * J / L])
    rotation = np.array([x / L, [0, 1, 0], np.cross(x / L, [0, 1, 0])])
    axes = np.kron(np.eye(2), rotation)
    arm = ends.mean(axis=0) - [0.08, 0.05, 0.03]
    carried = np.eye(6)
    carried[:3, 3:] = np.column_stack([np.cross(e, arm) for e in np.eye(3)])
    by_hand = carried.T @ axes.T @ own @ axes @ carried
    np.testing.assert_allclose(K, by_hand, atol=1e-6 * np.abs(K).max())


@pytest.mark.parametrize("weld", [FAST, WELD])
def test_welded_sheets_are_free(weld: str, tmp_path: Path) -> None:
    """Rigid motions cost no energy, and one weld joins two parts to one."""
    a = joined(tmp_path, deck(weld, held=False))
    assert "6 of 6 rigid motions are free" in a["facts"]["summary"]
    values = np.linalg.eigvalsh(a["K"].toarray())
    assert np.abs(values[:6]).max() < 1e-9 * values[-1] < values[6] * 1e3
    x, c = a["position"], a["component"]
    for axis in range(3):
        turn = np.where(
            c < 3, np.cross(np.eye(3)[axis], x)[np.arange(len(c)), c % 3], c == 3 + axis
        )
        assert np.abs(a["K"] @ turn).max() < 1e-8 * abs(a["K"]).max()


@pytest.mark.parametrize(
    ("weld", "words"),
    [
        (FAST.replace(",300", ""), "CFAST 90: its place must be given by GS"),
        (FAST.replace("PROP,1,2", "ELEM,1000,7"), "CFAST 90: element 7 is no shell"),
        (FAST.replace("1.+7,1.+7", "1.+7,2.+7"), "KT2 and KT3"),
        (WELD.replace("PARTPAT", "GRID"), "CWELD 90: GRID is not supported"),
        (WELD.replace("PARTPAT\n,1,2", "GRIDID,,,Q\n,13,14,24,23"), "90: SPTYP Q is not supported"),
        (WELD.replace("PARTPAT\n,1,2", "GRIDID,,,QQ\n,13,14,24,23"), "corners of B are missing"),
        (WELD.replace("PWELD,9", "PWELD,8"), "there is no PWELD 9"),
        (WELD.replace(",1,2\n", ",1,7\n"), "property 7 has no shells"),
    ],
)
def test_welds_that_are_not_followed(weld: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=words):
        joined(tmp_path, deck(weld))


def test_sheets_of_one_property(tmp_path: Path) -> None:
    """A weld by elements stays on these and their neighbours; by properties it is refused."""
    by_hand = expected([3e7, 1e7, 1e7, 40, 25, 25])
    text = deck(FAST.replace("PROP,1,2", "ELEM,1024,2022"))
    for e in range(2000, 2050):
        text = text.replace(f"CQUAD4,{e},2,", f"CQUAD4,{e},1,")
    K = joined(tmp_path, text)["K"].toarray()
    np.testing.assert_allclose(K, by_hand, atol=1e-9 * np.abs(K).max())
    with pytest.raises(BodyError, match="joins a property with itself"):
        joined(tmp_path, deck(FAST.replace("PROP,1,2", "PROP,1,1")))


def test_a_weld_as_long_as_its_sheets_are_thick(tmp_path: Path) -> None:
    """PWELD of type SPOT; and limits of the length of others."""
    A = np.pi * 0.006**2 / 4
    for more, length in ((",,,,,SPOT", 0.001), (",,,,,,\n,2.,5.", 0.012)):
        text = deck(WELD.replace("PWELD,9,1,0.006", f"PWELD,9,1,0.006{more}"))
        K = joined(tmp_path, text)["K"].toarray()
        assert K[2, 2] == pytest.approx(E_ * A / length, rel=1e-6)


def test_axes_of_a_system(tmp_path: Path) -> None:
    with pytest.raises(BodyError, match="MFLAG = 1"):
        joined(tmp_path, deck(FAST.replace("0.006,,,", "0.006,0,1,")))
