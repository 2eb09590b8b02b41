"""Loads of a body's own spin: what they are, what is claimed of them, and what they are for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from bodies import box, write_body_file
from conftest import assembled, assert_certified, certified, message, run
from flexgram import BodyError, Matrices, ReducedModel, reduce
from flexgram.model.geometry import interface_motion
from referee import System

PAIRS = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "zx": (2, 0)}
BAND = (100.0, 6000.0)


@pytest.fixture(scope="module")
def rotor(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A free box, one end spread over a reference."""
    folder = tmp_path_factory.mktemp("spin")
    mesh = box("tetra10", (6, 3, 3))
    write_body_file(
        folder / "mesh.h5",
        mesh,
        damping=(20.0, 1e-6, 0.0),
        interfaces={end: {"set": end, "coupling": "distributing"} for end in ("start", "end")},
    )
    return folder / "mesh.h5", assembled(folder / "matrices.h5", folder / "mesh.h5")


def loads(body: dict[str, Any]) -> Any:
    """What ω_x² and so on are multiplied by, as M times −ω × (ω × x), x from the centre."""
    x, axis, M = body["position"], body["component"], body["M"]
    weight = np.asarray(M.sum(axis=0)).ravel()
    x = x - weight @ x / weight.sum()
    columns = []
    for b, c in PAIRS.values():
        field = np.zeros_like(x)
        if b == c:
            field[:] = x
            field[:, b] = 0
        else:
            field[:, b], field[:, c] = -x[:, c], -x[:, b]
        columns.append(M @ field[np.arange(len(x)), axis])
    return np.array(columns).T


@pytest.mark.kernels
@pytest.mark.parametrize("ranks", [1, 2])
def test_spin_loads_are_certified(rotor: Any, ranks: int, tmp_path: Path) -> None:
    mesh, body = rotor
    B = np.hstack([body["B"], loads(body)])
    full = System(body["K"], body["M"], B, alpha=20.0, beta=1e-6)
    band = f"{BAND[0]},{BAND[1]}"
    result = certified(
        mesh, BAND, tmp_path, "-mor_tol", "1e-4", "-mor_spin_loads", "yes", ranks=ranks, full=full
    )
    assert_certified(result, 1e-4)
    rom = ReducedModel.load(result["path"])
    assert rom.inputs[12:] == [f"frame.spin{pair}" for pair in PAIRS] == rom.outputs[12:]
    assert {"displacement from spin", "inertia from spin", "inertia from force"} <= set(rom.kinds)
    assert list(interface_motion(rom)) == ["start", "end"]
    assert rom.bounds_elastic_part and "warnings" not in rom.log
    pointwise = tmp_path / "pointwise.h5"
    told = run(
        "reduce",
        "-body",
        mesh,
        "-mor_band_hz",
        band,
        "-mor_tol",
        "1e-4",
        "-mor_spin_loads",
        "yes",
        "-mor_tol_relative_to",
        "pointwise",
        "-mor_out",
        pointwise,
    )
    assert "only --tol-relative-to both or elastic bounds what a spin does" in told.out + told.err


def test_inertia_grows_as_it_does(rotor: Any) -> None:
    """The elastic answer to a constant spin, as a multibody code makes it of frame integrals,
    against that of the whole body; without these loads the basis misses most of it."""
    mesh, body = rotor
    L = loads(body)
    x = body["position"] - np.average(body["position"], axis=0)
    rigid = np.zeros((len(x), 6))
    for i in range(6):
        vectors = np.tile(np.eye(3)[i], (len(x), 1)) if i < 3 else np.cross(np.eye(3)[i - 3], x)
        rigid[:, i] = vectors[np.arange(len(x)), body["component"]]
    rigid = rigid @ np.linalg.inv(np.linalg.cholesky(rigid.T @ (body["M"] @ rigid))).T
    balanced = L - body["M"] @ rigid @ (rigid.T @ L)
    K = body["K"].toarray() + 1e9 * (body["M"] @ rigid) @ (body["M"] @ rigid).T
    whole = np.diag(balanced.T @ np.linalg.solve(K, balanced))[:3]
    missing = {}
    for spin in ("yes", "no"):
        rom = reduce(str(mesh), BAND, 1e-4, options={"mor_spin_loads": spin})
        elastic = rom.elastic()
        first = elastic.frame["inertia_first"]
        load = np.array([first[a, a] for a in range(3)]).T
        part = np.diag(load.T @ np.linalg.solve(elastic.K, load))
        missing[spin] = np.abs(1 - part / whole).max()
    assert missing["yes"] < 1e-5 and missing["no"] > 0.5


def test_where_spin_loads_cannot_be(tmp_path: Path, rotor: Any) -> None:
    body = Matrices(
        K=sp.diags([1e4, 9e4]).tocsr(),
        M=sp.identity(2, format="csr"),
        B=np.eye(2),
        inputs=["a", "b"],
    )
    with pytest.raises(BodyError, match="spin_loads: the body has no coordinates"):
        reduce(body, (1, 10), 1e-3, options={"mor_spin_loads": "yes"})
    said = run(
        "reduce", "-body", rotor[0], "-mor_band_hz", "100,3000", "-mor_out", tmp_path / "rom.h5"
    )
    assert "--spin-loads yes" in said.out
    result = run(
        "reduce",
        "-body",
        rotor[0],
        "-mor_spin_loads",
        "perhaps",
        "-mor_out",
        tmp_path / "rom.h5",
        expect=1,
    )
    assert "--spin-loads" in message(result)
