"""Reductions for loads instead of each port: leading patterns, and tables of a user's own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from bodies import box, write_body_file
from conftest import assembled, message, rom_matrices, rom_transfer, run
from flexgram import ReducedModel, certify, reduce
from flexgram.basics import BodyError
from flexgram.body.bodyfile import write_matrices
from referee import System

LAST = 12000.0


@pytest.fixture(scope="module")
def faces(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, System, list[str]]:
    """A bar with a port in each translation of each node of its two ends."""
    folder = tmp_path_factory.mktemp("faces")
    mesh = folder / "mesh.h5"
    write_body_file(
        mesh,
        box("hexahedron20", (8, 3, 3), (0.16, 0.06, 0.06)),
        interfaces={"start": {"set": "start", "coupling": "distributing"}},
    )
    body = assembled(folder / "matrices.h5", mesh)
    x = body["position"][:, 0]
    rows = np.flatnonzero((x < x.min() + 1e-9) | (x > x.max() - 1e-9))
    B = np.zeros((len(x), len(rows)))
    B[rows, range(len(rows))] = 1
    names = [f"n{body['node'][r]}.f{'xyz'[body['component'][r]]}" for r in rows]
    path = folder / "faces.h5"
    write_matrices(path, body["K"], body["M"], sp.csr_matrix(B), inputs=names, alpha=10.0)
    return path, System(body["K"], body["M"], B, alpha=10.0), names


def certified_for(rom: dict[str, Any], truth: System, P: Any) -> tuple[float, float]:
    """The largest relative error in the span of the patterns P, of the Frobenius norm and of random
    loads, at frequencies that the program does not know."""
    rng = np.random.default_rng(5)
    worst, of_loads = 0.0, 0.0
    for omega in 2 * np.pi * np.linspace(13, LAST - 11, 21):
        A = truth.K + 1j * omega * truth.alpha * truth.M - omega**2 * truth.M
        H = P.T @ truth.B.T @ splu(A.tocsc()).solve((truth.B @ P).astype(complex))
        error = P.T @ rom_transfer(rom, omega) @ P - H
        worst = max(worst, np.linalg.norm(error) / np.linalg.norm(H))
        u = rng.standard_normal((P.shape[1], 20))
        sizes = np.linalg.norm(error @ u, axis=0) / np.linalg.norm(u, axis=0)
        of_loads = max(of_loads, sizes.max() / np.linalg.norm(H))
    return worst, of_loads


@pytest.mark.parametrize("ranks", [1, 2])
def test_leading_patterns_are_certified(faces: Any, ranks: int, tmp_path: Path) -> None:
    body, truth, names = faces
    out = tmp_path / "rom.h5"
    said = run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        f"10,{LAST}",
        "-mor_load_patterns",
        40,
        "-mor_tol",
        1e-4,
        "-mor_out",
        out,
        ranks=ranks,
    ).out
    assert f"the leading 40 patterns of {len(names)} inputs" in said
    rom = rom_matrices(out)
    with h5py.File(out) as file:
        P, claimed = file["loads/patterns"][:], file["error"].attrs["worst"]
    model = ReducedModel.load(out)
    assert model.inputs == model.outputs == names
    assert model.label == "certified, of the motion along 40 loads in answer to them"
    worst, of_loads = certified_for(rom, truth, P)
    assert of_loads <= worst <= claimed <= 1e-4 and claimed < 30 * worst
    # Nearly the largest: no space of so many loads holds more of the static response. Of eight
    # random starts the worst held 0.990 of the first ten and 0.978 of all together.
    tau = (2 * np.pi * LAST) ** 2
    full = np.linalg.eigvalsh(
        truth.B.T @ np.linalg.solve((truth.K + tau * truth.M).toarray(), truth.B)
    )[::-1]
    Q = np.linalg.qr(P)[0]
    G = truth.B.T @ np.linalg.solve((truth.K + tau * truth.M).toarray(), truth.B @ Q)
    held = np.linalg.eigvalsh(Q.T @ G)[::-1]
    share = float(said.partition("inputs: ")[2].partition(" %")[0]) / 100
    assert share == pytest.approx(held.sum() / full.sum(), rel=0.1)
    assert np.all(held[:10] >= 0.98 * full[:10]) and held.sum() >= 0.97 * full[:40].sum()


def test_loads_of_a_table(faces: Any, tmp_path: Path) -> None:
    body, truth, names = faces
    rng = np.random.default_rng(1)
    P = np.zeros((len(names), 3))
    P[:60] = rng.standard_normal((60, 3))
    table = tmp_path / "loads.csv"
    table.write_text(
        "port, push, twist, shake\n"
        + "".join(
            f"{name}, {row[0]:.17g}, {row[1]:.17g}, {row[2]:.17g}\n"
            for name, row in zip(names[:60], P * [1e-9, 1.0, 1e160], strict=False)
        )
    )
    rom = reduce(body, band_hz=(10, LAST), tol=1e-6, options={"mor_loads": str(table)})
    P /= np.linalg.norm(P, axis=0)  # none counts less for the unit that it is written in
    assert rom.load_names == ["push", "twist", "shake"] and np.allclose(rom.loads, P, rtol=1e-14)
    fields = {"K": rom.K, "M": rom.M, "D": rom.D, "B": rom.B, "C": rom.C, "eta": rom.eta}
    worst, of_loads = certified_for(fields, truth, P)
    assert of_loads <= worst <= rom.certified_error <= 1e-6
    # It costs what three ports cost, not what the body has.
    assert rom.order < 60
    rom.save(tmp_path / "rom.h5")
    again = ReducedModel.load(tmp_path / "rom.h5")
    assert np.array_equal(again.loads, rom.loads) and again.label == rom.label
    with pytest.raises(BodyError, match="a medium model keeps each port"):
        certify(body, band_hz=(10, LAST), options={"mor_loads": str(table)})


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ("port,a\nnobody.fx,1\n", "line 2: the body has no input 'nobody.fx'"),
        ("port,a\n{0},1\n{0},2\n", "line 3: .* is there twice"),
        ("port,a,b\n{0},1\n", "line 2: 1 numbers, expected 2"),
        ("port,a\n{0},one\n", "line 2: 'one' is no number"),
        ("port,a\n{0},nan\n", "line 2: 'nan' is no number"),
        ("port,a,a\n{0},1,1\n", "line 1: load 'a' has no name or one that is there already"),
        ("{0},1\n{0},2\n", "line 1: expected a word for the ports and the names of the loads"),
        ("port\n", "line 1: expected a word for the ports and the names of the loads"),
        ("port,a,b\n{0},1,0\n", "load 'b' is zero"),
        ("", "is empty"),
    ],
)
def test_tables_that_are_none(faces: Any, table: str, expected: str, tmp_path: Path) -> None:
    body, _, names = faces
    path = tmp_path / "loads.csv"
    path.write_text(table.format(names[0]))
    with pytest.raises(BodyError, match=expected):
        reduce(body, band_hz=(10, LAST), options={"mor_loads": str(path)})


def test_options_that_contradict(faces: Any, tmp_path: Path) -> None:
    body = faces[0]
    both = run("reduce", "-body", body, "-mor_loads", "a.csv", "-mor_load_patterns", 3, expect=1)
    assert "exclude each other" in message(both)
    tangent = run(
        "reduce", "-body", body, "-mor_load_patterns", 3, "-mor_frame", "tangent", expect=1
    )
    assert "--frame tangent follows an interface" in message(tangent)
    # Loads at some of the inputs.
    some = run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        f"10,{LAST}",
        "-mor_load_patterns",
        4,
        "-mor_inputs",
        ",".join(faces[2][:9]),
        "-mor_out",
        tmp_path / "some.h5",
    )
    assert "the leading 4 patterns of 9 inputs" in some.out
    assert ReducedModel.load(tmp_path / "some.h5").inputs == faces[2][:9]
    few = run("reduce", "-body", body, "-mor_load_patterns", -1, expect=1)
    assert "--load-patterns" in message(few)
