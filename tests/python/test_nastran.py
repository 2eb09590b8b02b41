"""Nastran decks as they are: cards of no interest, coordinate systems, external superelements."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse as sp
from test_importers import assert_same

from bodies import box, small, write_body_file
from conftest import assembled
from flexgram import BodyError, reduce
from flexgram.importers import Interface, import_matrices, read
from flexgram.importers.interfaces import attach

BDF = pytest.importorskip("pyNastran.bdf.bdf").BDF

#: What decks hold besides grids: right, wrong, unknown, of other solvers.
UNRELATED = """\
PARAM,POST,-1
MAT1,1,2.1+11,,0.3,7850.
PSOLID,1,1
PSHELL,2,no number,0.1
FOOBAR,1,2,3
CBUSH,77,99,1,2,,,,0
PBUSH,99,K,1.+6
CONTACT,what,ever
TEMPD,1,20.
NLPARM,10,,,,ITER
LOAD,1,abc
EIGRL,1,,,10
CORD2R,1,,0.,0.,0.,0.,0.,1.
,1.,0.,0.
"""


def punched(path: Path, dofs: list[tuple[int, int]], **matrices: Any) -> Path:
    """A punch file that pyNastran wrote; of matrices that are not symmetric all entries."""
    model = BDF(debug=None)
    for name, matrix in matrices.items():
        whole = sp.csr_matrix(matrix)
        is_symmetric = (whole != whole.T).nnz == 0
        upper = sp.coo_matrix(sp.triu(whole) if is_symmetric else whole)
        model.add_dmig(
            name,
            6 if is_symmetric else 1,
            2,
            0,
            0,
            len(dofs),
            [dofs[j] for j in upper.col],
            [dofs[i] for i in upper.row],
            upper.data.tolist(),
        )
    model.write_bdf(str(path), write_header=False, enddata=False)
    return path


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("solid")
    mesh = folder / "mesh.h5"
    write_body_file(
        mesh,
        box("hexahedron", (3, 2, 2), (0.3, 0.2, 0.1)),
        interfaces={"start": {"set": "start", "coupling": "distributing"}},
    )
    return assembled(folder / "matrices.h5", mesh)


def bulk(body: dict[str, Any], cd: dict[int, int], extra: str, systems: str = "") -> str:
    grids = ""
    for label in np.unique(body["node"]):
        x = body["position"][body["node"] == label][0]
        fields = [f"{v:.9E}".replace("E", "D") for v in x]
        grids += f"GRID*,{label + 1},,{fields[0]},{fields[1]}\n*,{fields[2]},{cd.get(label, '')}\n"
    return f"SOL 103\nCEND\n$ a comment\nBEGIN BULK\n{systems}{extra}{grids}ENDDATA\n"


@pytest.mark.parametrize("control", [True, False])
def test_unrelated_cards_do_not_matter(body: Any, control: bool, tmp_path: Path) -> None:
    dofs = [(int(n) + 1, int(c) + 1) for n, c in zip(body["node"], body["component"], strict=True)]
    path = punched(tmp_path / "part.pch", dofs, KAAX=body["K"], MAAX=body["M"])
    text = bulk(body, {}, UNRELATED)
    deck = tmp_path / "part.bdf"
    deck.write_text(text if control else text.partition("BEGIN BULK\n")[2])
    fe = read(path, deck=deck)
    order = np.lexsort((body["component"], body["node"]))
    assert np.allclose(fe.positions(fe.node), body["position"][order], rtol=1e-8)
    import_matrices(fe, tmp_path / "part.h5", [Interface("tip", "node", np.array([1]))])
    deck.write_text(text.replace("GRID*,3,", "GRID*,3,17"))
    with pytest.raises(BodyError, match=r"part\.bdf: its grids cannot be placed"):
        read(path, deck=deck)


def test_displacement_coordinate_systems(body: Any, tmp_path: Path) -> None:
    """Grids with CD: rows in a turned, a cylindrical and a spherical system are the same body, and
    skew parts of K and D stay."""
    labels = np.unique(body["node"])
    cd = {int(label): (5, 6, 7)[i % 3] for i, label in enumerate(labels) if i % 4 < 3}
    R = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0]
    R *= np.sign(np.linalg.det(R))  # rows: axes of all three systems, origins off the body
    origin = np.array([-0.2, 0.5, 0.3])
    systems = "".join(
        f"CORD2{kind}*,{number},,{origin[0]:.12f},{origin[1]:.12f}\n"
        f"*,{origin[2]:.12f},{(origin + R[2])[0]:.12f},{(origin + R[2])[1]:.12f},"
        f"{(origin + R[2])[2]:.12f}\n*,{(origin + R[0])[0]:.12f},{(origin + R[0])[1]:.12f},"
        f"{(origin + R[0])[2]:.12f}\n"
        for number, kind in ((5, "R"), (6, "C"), (7, "S"))
    )
    blocks, dofs = [], []
    order = np.lexsort((body["component"], body["node"]))
    for label in labels:
        x = body["position"][body["node"] == label][0]
        axes = np.eye(3)
        if label in cd:
            local = R @ (x - origin)
            e = {5: np.eye(3)}
            e_r = np.array([local[0], local[1], 0]) / np.hypot(local[0], local[1])
            e[6] = np.array([e_r, np.cross([0, 0, 1], e_r), [0, 0, 1]])
            e_R = local / np.linalg.norm(local)
            e_phi = np.cross([0, 0, 1], e_r)
            e[7] = np.array([e_R, np.cross(e_phi, e_R), e_phi])
            axes = e[cd[int(label)]] @ R
        blocks.append(axes)
        dofs += [(int(label) + 1, c) for c in (1, 2, 3)]
    Q = sl.block_diag(*blocks)  # local = Q basic
    K, M = (Q @ body[name].toarray()[np.ix_(order, order)] @ Q.T for name in "KM")
    path = punched(tmp_path / "cd.pch", dofs, KAAX=0.5 * (K + K.T), MAAX=0.5 * (M + M.T))
    skew = np.random.default_rng(5).standard_normal(K.shape)
    skew -= skew.T
    skew *= np.abs(K).max() * 1e-3
    own = {name: 0.5 * (A + A.T) for name, A in (("KAAX", K), ("MAAX", M))}
    turning = punched(
        tmp_path / "turning.pch",
        dofs,
        **own | {"KAAX": own["KAAX"] + skew, "BAAX": 1e-4 * own["KAAX"] + 2 * skew},
    )
    deck = tmp_path / "cd.bdf"
    deck.write_text(bulk(body, cd, UNRELATED, systems))
    fe = read(path, deck=deck)
    for name in "KM":
        exact = body[name].toarray()[np.ix_(order, order)]
        # Printed with 16 digits at most, in fields of 16 characters.
        assert np.abs(getattr(fe, name).toarray() - exact).max() < 1e-8 * np.abs(exact).max()
    assert any("displacement coordinate systems (CD)" in line for line in fe.remarks)
    fe, back = read(turning, deck=deck), Q.T @ skew @ Q
    assert not fe.is_symmetric and fe.D is not None
    for matrix, size in ((fe.K, 1), (fe.D, 2)):
        part = 0.5 * (matrix - matrix.T).toarray()
        assert np.abs(part - size * back).max() < 1e-5 * size * np.abs(back).max()
    keep = [i for i, (label, c) in enumerate(dofs) if not (label - 1 in cd and c == 2)]
    cut = punched(
        tmp_path / "cut.pch",
        [dofs[i] for i in keep],
        KAAX=K[np.ix_(keep, keep)],
        MAAX=M[np.ix_(keep, keep)],
    )
    with pytest.raises(BodyError, match="only 2 of three components in the matrices"):
        read(cut, deck=deck)


def test_an_external_superelement_is_a_reduced_body(body: Any, tmp_path: Path) -> None:
    """EXTSEOUT(DMIGPCH): boundary grids first, modal coordinates as scalar points."""
    K, M = body["K"].toarray(), body["M"].toarray()
    at = body["position"]
    corner = [int(body["node"][np.argmin(at @ d)]) for d in ([1, 1, 1], [-1, -1, -1])]
    boundary = [
        int(np.flatnonzero((body["node"] == n) & (body["component"] == c))[0])
        for n in corner
        for c in range(3)
    ]
    inner = np.setdiff1d(np.arange(len(K)), boundary)
    static = -np.linalg.solve(K[np.ix_(inner, inner)], K[np.ix_(inner, boundary)])
    modes = sl.eigh(K[np.ix_(inner, inner)], M[np.ix_(inner, inner)])[1]
    V = np.zeros((len(K), 6 + 20))
    V[boundary, range(6)] = 1
    V[np.ix_(inner, range(6))] = static
    V[inner, 6:] = modes[:, :20]
    dofs = [(n + 1, c) for n in corner for c in (1, 2, 3)]
    dofs += [(900001 + j, 0) for j in range(20)]
    reduced = {name: V.T @ matrix @ V for name, matrix in (("KAAX", K), ("MAAX", M))}
    for matrix in reduced.values():
        matrix[:] = 0.5 * (matrix + matrix.T)
    path = punched(tmp_path / "ext.pch", dofs, **reduced, K4AAX=np.eye(26))
    deck = tmp_path / "ext.bdf"
    deck.write_text(bulk(body, {}, UNRELATED))
    for given in (None, deck):
        fe = read(path, deck=given)
        assert any("20 scalar points are modal coordinates" in line for line in fe.remarks)
        out = tmp_path / "ext.h5"
        import_matrices(fe, out, [Interface("tip", "node", np.array([corner[1] + 1]))], alpha=9.0)
        rom = reduce(out, (10, 2000), 1e-4)
        assert rom.inputs == ["tip.fx", "tip.fy", "tip.fz"]
        omega = 2 * np.pi * 777.0
        P = V[boundary[3:]]
        A = reduced["KAAX"] + (9j * omega - omega**2) * reduced["MAAX"]
        exact = P @ np.linalg.solve(A, P.T)
        error = np.linalg.norm(rom.transfer(omega) - exact) / np.linalg.norm(exact)
        assert error <= rom.certified_error <= 1e-4


def test_nastran_dmig_and_op4(tmp_path: Path) -> None:
    """Punch and OP4 that pyNastran wrote."""
    K, M = small()
    dofs = [(5, 1), (5, 2), (5, 3), (7, 1), (7, 2), (7, 3), (9, 1), (9, 3)]
    model = BDF(debug=None)
    for name, matrix in (("KAAX", K), ("MAAX", M)):
        upper = sp.triu(matrix).tocoo()
        model.add_dmig(
            name,
            6,
            2,
            0,
            0,
            8,
            [dofs[j] for j in upper.col],
            [dofs[i] for i in upper.row],
            upper.data.tolist(),
        )
    model.write_bdf(str(tmp_path / "part.pch"), write_header=False, enddata=False)
    deck = tmp_path / "part.bdf"
    grids = {5: (0, 0, 0), 7: (1, 0, 0), 9: (0, 1, 0), 20: (0.5, 0.5, 0)}
    deck.write_text(
        "CEND\nBEGIN BULK\n"
        + "".join(f"GRID,{g},,{x:.1f},{y:.1f},{z:.1f}\n" for g, (x, y, z) in grids.items())
        + "RBE2,31,20,123456,5,7\nENDDATA\n"
    )
    fe = read(tmp_path / "part.pch", deck=deck)
    assert_same(fe, K, M)
    assert list(zip(fe.node, fe.component + 1, strict=True)) == dofs
    assert [(i.name, i.coupling) for i in fe.interfaces] == [("RBE2-31", "rigid")]
    with pytest.raises(BodyError, match="RBE2-31 has 2 nodes on a line"):
        attach(fe, fe.interfaces)

    from pyNastran.op4.op4 import OP4

    OP4().write_op4(
        str(tmp_path / "part.op4"),
        {"KAA": (6, K.toarray()), "MAA": (6, M.toarray())},
        is_binary=False,
    )
    assert_same(read(tmp_path / "part.op4"), K, M)


def test_nastran_weights_components_and_structural_damping(tmp_path: Path) -> None:
    K = sp.eye(12).tocsr() * 1e6 + sp.diags([np.ones(11), np.ones(11)], [-1, 1])
    dofs = [(g, c) for g in (1, 2, 3, 4) for c in (1, 2, 3)]
    model = BDF(debug=None)
    flip = np.random.default_rng(1).random(23) < 0.5
    for name, matrix in (("KAAX", K), ("MAAX", sp.eye(12)), ("K4AAX", sp.eye(12))):
        upper = sp.triu(matrix).tocoo()
        pairs = [
            (j, i) if flip[k % 23] else (i, j)
            for k, (i, j) in enumerate(zip(upper.row, upper.col, strict=True))
        ]
        model.add_dmig(
            name,
            6,
            2,
            0,
            0,
            12,
            [dofs[j] for _, j in pairs],
            [dofs[i] for i, _ in pairs],
            upper.data.tolist(),
        )
    model.write_bdf(str(tmp_path / "p.pch"), write_header=False, enddata=False)
    grids = "".join(
        f"GRID,{i + 1},,{x:.1f},{y:.1f},0.0\n"
        for i, (x, y) in enumerate([(0, 0), (1, 0), (0, 1), (1, 1)])
    )
    grids += "GRID,9,,0.5,0.5,0.0\n"

    def deck(rigid: str) -> Path:
        (tmp_path / "p.bdf").write_text(f"CEND\nBEGIN BULK\n{grids}{rigid}ENDDATA\n")
        return tmp_path / "p.bdf"

    weighted = deck("RBE3,7,,9,123456,10.0,123,1,1.0\n+,123,2,3,4\n")
    fe = read(tmp_path / "p.pch", deck=weighted)
    assert abs(fe.K - K).max() == 0 and "K4AAX" in fe.remarks[0]  # either triangle
    B = attach(fe, fe.interfaces)["B"]
    # The centroid of a load of weights 10:1:1:1 is not the middle: a force there has a moment too.
    weights, x = np.array([10, 1, 1, 1]), np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) - 0.5
    G = np.zeros((12, 6))
    for i in range(4):
        G[3 * i : 3 * i + 3, :3] = np.eye(3)
        for axis in range(3):
            G[3 * i : 3 * i + 3, 3 + axis] = np.cross(np.eye(3)[axis], [*x[i], 0])
    W = np.diag(np.repeat(weights, 3))
    assert np.allclose(B, W @ G @ np.linalg.inv(G.T @ W @ G))
    with pytest.raises(BodyError, match="RBE2 8 couples the components 12;"):
        read(tmp_path / "p.pch", deck=deck("RBE2,8,9,12,1,2\n"))
