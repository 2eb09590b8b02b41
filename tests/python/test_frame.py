"""Frame integrals of the reduced file against volume integrals and against M itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

from bodies import box, write_body_file
from conftest import assembled, run
from flexgram.body.bodyfile import write_matrices

SIZE = (0.3, 0.2, 0.1)
RHO = 7850.0
BASIS = np.eye(3)


def reduced(tmp_path: Path, coupling: str, ranks: int, *options: str) -> tuple[Path, Path]:
    mesh = box("tetra10", (4, 3, 2), SIZE, distort=False)
    body, rom = tmp_path / "body.h5", tmp_path / "rom.h5"
    interfaces = {name: {"coupling": coupling, "set": name} for name in ("start", "end")}
    write_body_file(body, mesh, interfaces=interfaces, damping=(2, 1e-6, 0))
    run(
        "reduce",
        "-body",
        body,
        "-mor_band_hz",
        "10,3000",
        "-mor_tol",
        "1e-3",
        "-mor_out",
        rom,
        *options,
        ranks=ranks,
    )
    return body, rom


def integrals(rom: Path) -> dict[str, Any]:
    with h5py.File(rom) as file:
        data = {key: value[:] for key, value in file["frame"].items()}
        node = file["nodes/id"][:][file["dofs/node"][:]]
        order = np.lexsort((file["dofs/component"][:], node))  # rows differ with the ranks
        return {**data, **dict(file["frame"].attrs), "V": file["V"][:][order], "M": file["M"][:]}


def nodal_fields(data: dict[str, Any]) -> tuple[Any, Any]:
    """[T R] and the matrices G_a, node by node in plain loops."""
    n = len(data["node"])
    row = {(a, c): i for i, (a, c) in enumerate(zip(data["node"], data["component"], strict=True))}
    motions, turns = np.zeros((n, 6)), np.zeros((3, n, n))
    for (node, component), i in row.items():
        half = component - component % 3
        for a in range(3):
            if component < 3:
                motions[i, a] = BASIS[a, component]
                motions[i, 3 + a] = np.cross(BASIS[a], data["position"][i])[component]
            else:
                motions[i, 3 + a] = BASIS[a, component - 3]
            for other in range(3):
                value = np.cross(BASIS[a], BASIS[other])[component % 3]
                if value and (node, half + other) in row:
                    turns[a, i, row[node, half + other]] = value
    return motions, turns


def check_integrals(got: dict[str, Any], M: Any, V: Any, motions: Any, turns: Any) -> None:
    """Against products with M, in the definitions of ``FrameIntegrals``."""
    GV = np.einsum("aij,jk->aik", turns, V)
    expected = {
        "M_r": motions.T @ M @ motions,
        "M_er": V.T @ M @ motions,
        "gyroscopic": np.einsum("ij,ail->jal", M @ V, GV),
        "inertia_first": np.einsum("ia,bij->abj", M @ motions[:, 3:], GV),
        "inertia_second": np.einsum(
            "aij,bik->ajbk", GV, np.stack([M @ g for g in GV]), optimize=True
        ),
    }
    for name, value in expected.items():
        assert got[name].shape == value.shape, name
        assert np.abs(got[name] - value).max() <= 1e-11 * np.abs(value).max(), name


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("coupling", ["rigid", "distributing"])
def test_against_the_mass_matrix(tmp_path: Path, coupling: str, ranks: int) -> None:
    body, rom = reduced(tmp_path, coupling, ranks)
    got = integrals(rom)
    matrices = assembled(tmp_path / "matrices.h5", body)
    order = np.lexsort((matrices["component"], matrices["node"]))
    for name in ("node", "component", "position"):
        matrices[name] = matrices[name][order]
    matrices["M"] = matrices["M"][order][:, order]
    motions, turns = nodal_fields(matrices)
    M, V = matrices["M"], got["V"]
    check_integrals(got, M, V, motions, turns)


def test_against_volume_integrals(tmp_path: Path) -> None:
    """A box with corner at the origin: mass, centre, inertia; a solid's identities."""
    _, rom = reduced(tmp_path, "distributing", 1)
    got = integrals(rom)
    a, b, c = SIZE
    mass, centre = RHO * a * b * c, np.array(SIZE) / 2
    assert got["mass"] == pytest.approx(mass, rel=1e-12)
    assert np.allclose(got["centre"], centre, rtol=1e-12)
    about_centre = mass / 12 * np.diag([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    shift = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    assert np.allclose(got["M_r"][3:, 3:], about_centre + shift, atol=1e-12 * mass)
    # Buckens: the elastic vectors (behind six rigid ones) carry no momentum.
    assert np.abs(got["M_er"][6:]).max() < 1e-11 * np.abs(got["M_r"]).max() ** 0.5
    # (e_a × φ_j)·(e_a × φ_k) summed over a is 2 φ_j·φ_k; φ_j·(e_a × φ_k) is antisymmetric.
    trace = np.einsum("ajak->jk", got["inertia_second"])
    assert np.allclose(trace, 2 * got["M"], atol=1e-11)
    assert np.allclose(got["gyroscopic"], -np.swapaxes(got["gyroscopic"], 0, 2), atol=1e-11)


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", ["the same", "but in some rows", "none"])
def test_masses_by_directions(tmp_path: Path, kind: str, ranks: int) -> None:
    """M that is the same in all directions, but near some nodes, or nowhere; the rows of a node in
    any order, on any rank, some of them held."""
    rng = np.random.default_rng(len(kind))
    nodes, each = 40, 3 if kind == "the same" else 6
    node, component = (x.ravel() for x in np.indices((nodes, each)))
    places = rng.uniform(-1, 1, (nodes, 3))
    links = sp.random(nodes, nodes, 0.08, random_state=1)
    scalar = links @ links.T + sp.diags(rng.uniform(1, 2, nodes))
    M = sp.kron(scalar, sp.eye(each), "lil")
    few = range(each * nodes) if kind == "none" else () if kind == "the same" else range(18, 24)
    for i in few:
        M[i, i] += rng.uniform(0.5, 1)
        j = int(rng.integers(nodes * each))
        M[i, j] = M[j, i] = M[i, j] + 0.05
    springs = sp.random(nodes * each, nodes * each, 0.03, random_state=2)
    K = springs @ springs.T + sp.eye(nodes * each)
    held = [] if kind == "the same" else [31, 100, 101]
    order = rng.permutation(np.setdiff1d(np.arange(nodes * each), held))
    M, K = M.tocsr()[order][:, order], K.tocsr()[order][:, order]
    node, component = node[order], component[order]
    B = np.zeros((len(order), 3))
    B[[0, 5, 9], range(3)] = 1
    body = tmp_path / "body.h5"
    write_matrices(body, K, M, B, alpha=0.1, node=node, component=component, position=places)
    rom = tmp_path / "rom.h5"
    run(
        *("reduce", "-body", body, "-mor_band_hz", "0.01,0.4", "-mor_tol", "1e-2"),
        *("-mor_frame_integrals", "yes", "-mor_out", rom),
        ranks=ranks,
    )
    with h5py.File(rom) as file:
        got = {key: value[:] for key, value in file["frame"].items()}
        V, rows = file["V"][:], file["dofs/node"][:]
        names = file["nodes/id"][:][rows]
        data = {"node": names, "component": file["dofs/component"][:]}
    data["position"] = places[names]
    motions, turns = nodal_fields(data)
    at = {pair: i for i, pair in enumerate(zip(node, component, strict=True))}
    back = [at[pair] for pair in zip(names, data["component"], strict=True)]
    check_integrals(got, M.toarray()[np.ix_(back, back)], V, motions, turns)


def test_skipped_where_the_body_cannot_move(tmp_path: Path) -> None:
    _, rom = reduced(tmp_path, "rigid", 1, "-mor_frame_integrals", "no")
    with h5py.File(rom) as file:
        assert "M_r" not in file["frame"]
