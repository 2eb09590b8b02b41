"""Assemblies of reduced bodies against assemblies of the full ones."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from test_mesh_loads import sided

import flexgram
from bodies import box, write_body_file
from conftest import body_system, run
from flexgram import BodyError, ReducedModel
from flexgram.assembly.couple import PORTS, Joint, couple, verdict
from flexgram.assembly.small_gain import errors_of
from flexgram.body.description import import_description
from flexgram.body.matrices import Matrices
from flexgram.simulation.histories import ports_of

BAND = (0.05, 0.6)  # [Hz]


def random_body(rng: np.random.Generator, ports: int) -> tuple[Any, ...]:
    """A held body with n dofs, every port a force in a direction of an interface of its own."""
    n = int(rng.integers(30, 60))
    springs = sp.random(n, n, 0.15, random_state=int(rng.integers(1 << 30)))
    G = springs.toarray() - np.diag(springs.toarray().sum(axis=1))
    K = G @ G.T + np.diag(rng.uniform(0.5, 3, n))
    M = np.diag(rng.uniform(0.3, 2, n))
    B = np.zeros((n, ports))
    B[rng.choice(n, ports, replace=False), range(ports)] = 1
    names = [f"{name}.f{axis}" for name in ("a", "b") for axis in "xyz"][:ports]
    alpha, beta = rng.uniform(0.005, 0.05), rng.uniform(0.001, 0.02)
    return K, M, B, names, float(alpha), float(beta)


def reduced(body: tuple[Any, ...], tol: float, band: tuple[float, float] = BAND) -> ReducedModel:
    K, M, B, names, alpha, beta = body
    given = Matrices(sp.csr_matrix(K), sp.csr_matrix(M), B, inputs=names, alpha=alpha, beta=beta)
    return flexgram.reduce(given, band, tol)


def by_number(model: ReducedModel) -> ReducedModel:
    """The body with no more known of its error than how large it is."""
    model.claim.form = None
    return model


def full_response(
    bodies: list[tuple[Any, ...]], joints: list[Joint], keep: list[int], w: float
) -> Any:
    """H of the assembly of full bodies: constraints by Lagrange multipliers, springs in K."""
    K, M, D = (
        scipy.linalg.block_diag(*parts)
        for parts in (
            [b[0] for b in bodies],
            [b[1] for b in bodies],
            [b[4] * b[1] + b[5] * b[0] for b in bodies],
        )
    )
    B = scipy.linalg.block_diag(*(b[2] for b in bodies))
    names = [f"p{i}.{name}" for i, b in enumerate(bodies) for name in b[3]]
    A = (K + 1j * w * D - w * w * M).astype(complex)
    ties = []
    for joint in joints:
        for d in joint.directions or {*joint.stiffness, *joint.damping} or "xyz":
            g = B[:, names.index(f"{joint.first}.f{d}")].copy()
            if joint.second != "ground":
                g -= B[:, names.index(f"{joint.second}.f{d}")]
            if joint.ties:
                ties.append(g)
            else:
                k = joint.stiffness.get(d, 0) + 1j * w * joint.damping.get(d, 0)
                A += k * np.outer(g, g)
    t = len(ties)
    L = np.array(ties).reshape(t, len(K))
    whole = np.block([[A, L.T], [L, np.zeros((t, t))]])
    X = np.linalg.solve(whole, np.vstack([B[:, keep], np.zeros((t, len(keep)))]))[: len(K)]
    return B[:, keep].T @ X


def random_joints(rng: np.random.Generator) -> list[Joint]:
    axes = [str(a) for a in rng.permutation(list("xyz"))]
    joints = [Joint("p0.b", "p1.a", axes[: int(rng.integers(1, 4))])]
    kind = int(rng.integers(4))
    if kind == 1:
        joints = [Joint("p0.b", "p1.a", stiffness=dict.fromkeys("xyz", float(rng.uniform(0.5, 9))))]
    if kind == 2:
        joints.append(Joint("p1.a", "ground", stiffness={axes[0]: 2.0}, damping={axes[1]: 0.1}))
    if kind == 3:
        joints.append(
            Joint("p0.b", "ground", [axes[2]])
            if len(joints[0].directions) < 3
            else Joint("p0.b", "p1.a", damping={"x": 0.3})
        )
        if joints[1].second != "ground":
            joints = [joints[1]]
    return joints


@pytest.mark.parametrize(("form", "pairs"), [(True, 25), (False, 20)])
def test_random_pairs_keep_their_bound(form: bool, pairs: int) -> None:
    """Bound >= truth at frequencies of the test's own, and of use: by the form of the parts' errors
    nearly the error, by their sizes where the gain is small. The claim for the whole band holds
    there too and is hardly more than the largest that is seen."""
    rng = np.random.default_rng(7)
    closed, sharp, everywhere, proved = 0, [], [], 0
    for _ in range(pairs):
        bodies = [random_body(rng, 6), random_body(rng, 6)]
        parts = {
            f"p{i}": reduced(b, float(10 ** rng.uniform(-6, -2))) for i, b in enumerate(bodies)
        }
        if not form:
            parts = {name: by_number(part) for name, part in parts.items()}
        joints = random_joints(rng)
        whole = couple(parts, joints)
        joined = {"p0.b", "p1.a"}
        names = [f"p{i}.{name}" for i in range(2) for name in bodies[i][3]]
        keep = [k for k, name in enumerate(names) if name.rpartition(".")[0] not in joined]
        assert whole.inputs == [names[k] for k in keep] == whole.outputs
        w = 2 * np.pi * rng.uniform(*BAND, 15)
        said = verdict(parts, joints, omega=w)
        assert not said.unknown
        seen = verdict(parts, joints, omega=2 * np.pi * rng.uniform(*BAND, 150)).bound.max()
        if whole.kind == "certified":
            proved += 1
            everywhere.append(whole.certified_error / seen)
            assert seen <= whole.certified_error * (1 + 1e-9)
        else:
            assert whole.kind == "estimated"
        for x, bound in zip(w, said.bound, strict=True):
            H = full_response(bodies, joints, keep, x)
            true = np.linalg.norm(H - whole.transfer(x)) / np.linalg.norm(H)
            assert true <= bound * (1 + 1e-9) + 1e-10
            assert whole.kind != "certified" or true <= whole.certified_error + 1e-10
            closed += bool(np.isfinite(bound))
            if np.isfinite(bound) and true > 1e-12:
                sharp.append(bound / true)
        assert form == bool(np.all(np.isfinite(said.estimate)))
    assert closed > (1.0 if form else 0.8) * pairs * 15 - 1
    assert np.median(sharp) < (1.2 if form else 300)
    assert proved >= (1.0 if form else 0.9) * pairs and np.median(everywhere) < 1.3


def beam(rng: np.random.Generator) -> tuple[Any, ...]:
    """A free beam of Euler and Bernoulli with 40 elements, forces and moments at its ends. Its K
    does not resist rigid motion at all, in doubles: few digits, and lengths that are powers of two.
    """
    f = 10 ** rng.uniform(-0.5, 0.5, 3)
    h = 2.0 ** np.round(np.log2(f[0] / 40))
    mass, stiffness = 5 * f[2], float(np.float32(2e3 * f[1] / h**3))
    k = stiffness * np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h * h, -6 * h, 2 * h * h],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h * h, -6 * h, 4 * h * h],
        ]
    )
    m = (
        mass
        * h
        / 420
        * np.array(
            [
                [156, 22 * h, 54, -13 * h],
                [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                [54, 13 * h, 156, -22 * h],
                [-13 * h, -3 * h * h, -22 * h, 4 * h * h],
            ]
        )
    )
    K, M = np.zeros((2, 82, 82))
    for i in range(0, 80, 2):
        K[i : i + 4, i : i + 4] += k
        M[i : i + 4, i : i + 4] += m
    names = ["a.fy", "a.mz", "b.fy", "b.mz", "c.fy"]
    return K, M, np.eye(82)[:, [0, 1, 80, 81, 40]], names, 2.0, 2e-7


def exactly(A: Any, B: Any) -> Any:
    """A⁻¹B in long doubles, whose solution is improved until it is right to their digits."""
    factors = scipy.linalg.lu_factor(A.astype(complex))
    X = np.zeros_like(B)
    for _ in range(12):
        step = scipy.linalg.lu_solve(factors, (B - A @ X).astype(complex))
        X = X + step
        if abs(step).max() <= 1e-18 * abs(X).max():
            break
    return X


def long_response(parts: list[tuple[Any, ...]], spring: dict[str, float], w: float) -> Any:
    """H of two beams in long doubles, joined from b to a: the parts K, D, M, B."""
    x = np.clongdouble(w)
    A = [
        K + 1j * x * D - x * x * M
        for K, D, M, _ in ([np.asarray(a, dtype=np.longdouble) for a in part] for part in parts)
    ]
    n = len(A[0])
    whole = np.zeros((n + len(A[1]),) * 2, dtype=np.clongdouble)
    whole[:n, :n], whole[n:, n:] = A
    B = scipy.linalg.block_diag(*(part[3] for part in parts))
    gaps = B[:, [2, 3]] - B[:, [5, 6]]
    kept = B[:, [0, 1, 4, 7, 8, 9]].astype(np.clongdouble)
    if spring:
        gaps = gaps.astype(np.clongdouble)
        return kept.T @ exactly(whole + gaps * [spring["y"], spring["rz"]] @ gaps.T, kept)
    stiff = float(abs(whole).max())
    tied = np.block([[whole, stiff * gaps], [stiff * gaps.T, np.zeros((2, 2))]])
    return kept.T @ exactly(tied, np.vstack([kept, np.zeros((2, 6))]))[: len(whole)]


@pytest.mark.parametrize("tol", [1e-4, 1e-6])
def test_forces_and_moments_keep_a_bound_that_is_hardly_more_than_the_error(tol: float) -> None:
    """Beams joined by ties or springs in force and moment: parts by number close at 1e-7 or not at
    all; by their forms all close, and the bound is the error."""
    rng = np.random.default_rng(31)
    sharp = []
    for _ in range(8):
        bodies = [beam(rng) for _ in range(2)]
        spring = (
            {d: float(10 ** rng.uniform(4, 7)) for d in ("y", "rz")} if rng.random() < 0.5 else {}
        )
        parts = {f"p{i}": reduced(b, tol, (5, 800)) for i, b in enumerate(bodies)}
        joints = [Joint("p0.b", "p1.a", stiffness=spring)]
        whole = couple(parts, joints)
        assert whole.kind == "certified"
        w = 2 * np.pi * rng.uniform(5, 800, 8)
        said = verdict(parts, joints, omega=w)
        full = [(K, a * M + b * K, M, B) for K, M, B, _, a, b in bodies]
        small = [(m.K, m.D, m.M, m.B) for m in parts.values()]
        for x, bound, estimate in zip(w, said.bound, said.estimate, strict=True):
            H = long_response(full, spring, x)
            size = np.sqrt((abs(H) ** 2).sum())
            true = float(np.sqrt((abs(H - long_response(small, spring, x)) ** 2).sum()) / size)
            assert true <= bound * (1 + 1e-9) and true <= whole.certified_error
            assert 0.5 * true <= estimate <= bound
            sharp.append(bound / true)
    assert np.median(sharp) < (1.1 if tol > 1e-5 else 2)  # some of it is rounding


@pytest.mark.parametrize("relative_to", ["pointwise", "elastic"])
def test_parts_of_a_beam_are_the_beam(relative_to: str, tmp_path: Path) -> None:
    """Two halves, one of them turned, tied at a rigid face: modes and responses of the whole."""
    size = (0.3, 0.04, 0.03)
    half = box("tetra10", (8, 2, 2), size, distort=False)
    whole = box("tetra10", (16, 2, 2), (0.6, 0.04, 0.03), distort=False)
    middle = np.flatnonzero(np.abs(whole.points[:, 0] - 0.3) < 1e-9)
    whole.point_sets["middle"] = middle
    rigid = {"coupling": "rigid"}
    write_body_file(
        tmp_path / "whole.h5",
        whole,
        damping=(3, 2e-6, 0),
        interfaces={
            "start": {"set": "start", **rigid},
            "middle": {"set": "middle", **rigid},
            "end": {"set": "end", **rigid},
        },
    )
    write_body_file(
        tmp_path / "left.h5",
        half,
        damping=(3, 2e-6, 0),
        interfaces={name: {"set": name, **rigid} for name in ("start", "end")},
    )
    # The right half in axes of its own: turned by 90° about z, and somewhere else.
    R = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # of the assembly's axes to its own
    half.points = half.points @ R.T + [5.0, 1.0, -2.0]
    write_body_file(
        tmp_path / "right.h5",
        half,
        damping=(3, 2e-6, 0),
        interfaces={name: {"set": name, **rigid} for name in ("start", "end")},
    )
    for name in ("left", "right"):
        run(
            "reduce",
            "-body",
            tmp_path / f"{name}.h5",
            "-mor_band_hz",
            "50,3000",
            "-mor_tol",
            "1e-6",
            "-mor_tol_relative_to",
            relative_to,
            "-mor_out",
            tmp_path / f"{name}.rom.h5",
            ranks=2 if name == "right" else 1,
        )
    said = run(
        "couple",
        tmp_path / "left.rom.h5",
        tmp_path / "right.rom.h5",
        "--join",
        "left.end=right.start",
        "--turn",
        "right=0,0,90",
        "-o",
        tmp_path / "ab.rom.h5",
    ).out
    assert "wrote" in said and "by the parts' claims" in said
    model = ReducedModel.load(tmp_path / "ab.rom.h5")
    assert model.kind == model.label == "certified" and "everywhere in the band" in said
    run("assemble", "-body", tmp_path / "whole.h5", "-body_out", tmp_path / "matrices.h5")
    full = body_system(tmp_path / "matrices.h5")
    names = [f"left.start.{f}" for f in ("fx", "fy", "fz", "mx", "my", "mz")]
    rows = [model.inputs.index(name) for name in names]
    for hertz in (61.0, 740.0, 1777.0, 2900.0):
        w = 2 * np.pi * hertz
        H = full.transfer(w)[:6, :6]
        off = np.linalg.norm(model.transfer(w)[np.ix_(rows, rows)] - H)
        assert off < 1e-5 * np.linalg.norm(H)
    # Both ends, the far one in the axes of the right half, within what the halves' claims say.
    parts = {name: ReducedModel.load(tmp_path / f"{name}.rom.h5") for name in ("left", "right")}
    turn = scipy.linalg.block_diag(np.eye(6), R, R)
    # (not at 61 Hz, where the whole beam's K in doubles is right to no more than 1e-10)
    omega = 2 * np.pi * np.array([361.0, 740.0, 1777.0, 2900.0])
    said = verdict(
        parts, [Joint("left.end", "right.start")], omega=omega, turns={"right": [0, 0, np.pi / 2]}
    )
    ends = [*range(6), *range(12, 18)]
    for w, bound in zip(omega, said.bound, strict=True):
        H = turn @ full.transfer(w)[np.ix_(ends, ends)] @ turn.T
        true = np.linalg.norm(model.transfer(w) - H) / np.linalg.norm(H)
        assert 1e-12 < true <= bound <= min(1.5 * true, model.certified_error) < 1e-5


def test_without_damping_all_but_the_resonances(tmp_path: Path) -> None:
    """Nothing is claimed beside poles of the parts and of the assembly; next to these intervals and
    elsewhere the claim holds. An assembly is a part again."""
    rng = np.random.default_rng(11)
    bodies = [(*random_body(rng, 6)[:4], 0.0, 0.0) for _ in range(2)]
    parts = {f"p{i}": reduced(b, 1e-8) for i, b in enumerate(bodies)}
    joints = [Joint("p0.b", "p1.a"), Joint("p1.b", "ground", stiffness={"x": 2.0})]
    whole = couple(parts, joints, keep=["p1.b"])
    assert whole.kind == "certified outside" and len(whole.excluded) > 2
    path = tmp_path / "ab.rom.h5"
    whole.save(str(path))
    again = ReducedModel.load(path)
    assert "undamped resonances" in again.label and len(again.excluded) == len(whole.excluded)
    keep = [0, 1, 2, 9, 10, 11]
    near = np.concatenate([[a * (1 - 1e-9), b * (1 + 1e-9)] for a, b in whole.excluded])
    band = 2 * np.pi * np.array(BAND)
    w = np.concatenate(
        [near[(near > band[0]) & (near < band[1])], 2 * np.pi * rng.uniform(*BAND, 30)]
    )
    checked = 0
    for x in w:
        if np.any((whole.excluded[:, 0] <= x) & (x <= whole.excluded[:, 1])):
            continue
        H = full_response(bodies, joints, keep, x)
        assert np.linalg.norm(H - whole.transfer(x)) <= whole.certified_error * np.linalg.norm(H)
        checked += 1
    assert checked > 30
    pole = float(parts["p0"].excluded[3].mean())
    beside = dict.fromkeys(parts, None)
    for name, model in parts.items():
        beside[name] = object.__new__(ReducedModel)
        beside[name].__dict__.update(model.__dict__)
        around = np.array([[pole * (1 - 1e-8), pole * (1 + 1e-8)]])
        beside[name].claim = dataclasses.replace(model.claim, bands=around)
    nothing = couple(beside, joints, keep=["p1.b"])
    assert nothing.kind == "estimated" and "0 % of the band" in dict(nothing.log["plan"])["error"]
    poles = whole.modes[(whole.modes > band[0]) & (whole.modes < band[1])]
    assert len(poles) > 1
    for pole in poles:
        assert np.any((whole.excluded[:, 0] <= pole) & (pole <= whole.excluded[:, 1]))
    third = couple(
        {"ab": again, "c": reduced((*random_body(rng, 6)[:4], 0.02, 0.01), 1e-6)},
        [Joint("ab.p1.b", "c.a")],
    )
    assert "by the parts' claims" in dict(third.log["plan"])["error"]


def test_what_is_not_claimed_of_an_assembly_is_not_taken_for_zero() -> None:
    """A kind whose claim did not close everywhere has no number in the file; to the next assembly
    it is one that the claim of all of H covers, not one that is nothing but rounding."""
    rng = np.random.default_rng(9)
    bodies = [random_body(rng, 6) for _ in range(2)]
    part = couple(
        {f"p{i}": reduced(b, 1e-5) for i, b in enumerate(bodies)}, [Joint("p0.b", "p1.a")]
    )
    part.outputs[2] = "p0.a.sxx"
    part.claim.kinds, part.claim.by_kind = ["displacement from force"], np.array([1e-5])
    size = lambda rows, columns: np.asarray(1.0)  # noqa: E731
    kinds = ["displacement", "stress"], ["force"]
    zero = errors_of(part, *kinds, size, size)
    assert np.allclose(zero.ravel(), [min(1e-5, part.whole_error), part.whole_error], rtol=1e-4)
    part.claim.unclaimed = ["stress from force"]
    known = errors_of(part, *kinds, size, size)
    assert np.allclose(known, zero, rtol=1e-4)
    tiny = lambda rows, columns: np.asarray(1.0 if isinstance(rows, slice) else 1e-9)  # noqa: E731
    assert errors_of(part, *kinds, tiny, size)[1, 0] > 0.9 * part.whole_error
    part.claim.unclaimed = []
    assert errors_of(part, *kinds, tiny, size)[1, 0] == pytest.approx(2e-9)


def test_what_does_not_close_is_estimated() -> None:
    """Parts to 5e-2 say nothing where the gain is above one, and the share of the band is told."""
    rng = np.random.default_rng(21)
    bodies = [random_body(rng, 6) for _ in range(2)]
    parts = {f"p{i}": by_number(reduced(b, 0.3)) for i, b in enumerate(bodies)}
    joints = [Joint("p0.b", "p1.a")]
    whole = couple(parts, joints)
    assert whole.kind == "estimated"
    words = dict(whole.log["plan"])["error"]
    assert "% of the band" in words and "reduce the parts to a smaller tolerance" in words
    found = verdict(parts, joints)
    assert len(found.open) and np.all(np.diff(found.open, axis=1) > 0)
    for a, b in found.open:
        inside = verdict(parts, joints, omega=np.linspace(a, b, 9)[1:-1])
        assert inside.bound.max() > 0.9  # of H
    rng = np.random.default_rng(5)
    for x in 2 * np.pi * rng.uniform(*BAND, 200):
        at = verdict(parts, joints, omega=[x]).bound[0]
        shut = np.any((found.open[:, 0] <= x) & (x <= found.open[:, 1]))
        assert shut or at <= found.worst


def test_what_is_no_assembly() -> None:
    rng = np.random.default_rng(3)
    parts = {f"p{i}": reduced(random_body(rng, 6), 1e-3) for i in range(2)}
    for joints, words in (
        ([Joint("p0.c", "p1.a")], "p0.c is no interface; there are p0.a, p0.b, p1.a, p1.b"),
        ([Joint("q.a", "p1.a")], "there is no such part; there are p0, p1"),
        ([Joint("p0.a", "p1.a", ["rx"])], "p0.a has no rx"),
        ([Joint("p0.a", "p1.a", ["u"])], "u must be one of x"),
        ([Joint("p0.a", "p0.a")], "an interface with itself"),
        ([Joint("p0.a", "p1.a", stiffness={"x": 3.0, "Rx": 2.0})], "Rx must be one of x"),
        ([Joint("p0.a", "p1.a", ["x"], {"x": 3.0, "y": 2.0})], "y must be one of x"),
        ([Joint("p0.a", "p1.a", ["x", "y"], {"x": 3.0})], "no stiffness or damping in x"),
        ([Joint("p0.a", "p1.a", stiffness={"x": -3.0})], "x = -3.0 must be positive"),
        ([Joint("p0.a", "p1.a", damping={"x": float("nan")})], "x = nan must be positive"),
        ([Joint("p0.a", "p1.a"), Joint("p0.a", "p1.a", ["x"])], "hold the same motion"),
        ([Joint("p0.a", "p1.a"), Joint("p0.b", "p1.b")], "no port is left"),
    ):
        with pytest.raises(BodyError, match=words):
            couple(parts, joints)
    assert couple(parts, [Joint("p0.a", "p1.a"), Joint("p0.b", "p1.b")], keep=["p0.b"]).inputs == [
        "p0.b.fx",
        "p0.b.fy",
        "p0.b.fz",
    ]
    for turn in ([0, 0, 5e-14], [0, 0, 20 * np.pi]):  # none
        couple(parts, [Joint("p0.a", "p1.a", ["x"])], turns={"p1": turn})
    with pytest.raises(BodyError, match=r"q\.r\.fx is a port of two parts"):
        two = object.__new__(ReducedModel)
        two.__dict__.update(parts["p1"].__dict__)
        two.inputs = two.outputs = [name.replace("a.", "") for name in parts["p1"].inputs]
        one = object.__new__(ReducedModel)
        one.__dict__.update(parts["p0"].__dict__)
        one.inputs = one.outputs = [name.replace("a.", "r.") for name in parts["p0"].inputs]
        couple({"q": one, "q.r": two}, [])
    with pytest.raises(BodyError, match="keep ground: no joint has it"):
        couple(parts, [Joint("p0.a", "ground")], keep=["ground"])
    with pytest.raises(BodyError, match=r"keep nope\.x: no joint has it"):
        couple(parts, [Joint("p0.a", "p1.a")], keep=["nope.x"])
    with pytest.raises(BodyError, match="outside the band"):
        verdict(parts, [Joint("p0.a", "p1.a")], omega=[2 * np.pi * 5])
    by_number(parts["p1"]).claim.relative_to = "band"
    whole = couple(parts, [Joint("p0.a", "p1.a")])  # without a bound, and it says why
    assert whole.kind == "estimated" and not np.isfinite(whole.certified_error)
    assert "relative to the largest H of the band" in dict(whole.log["plan"])["error"]
    claim = parts["p1"].claim
    claim.relative_to, claim.load_names = "pointwise", ["few"]
    whole = couple(parts, [Joint("p0.a", "p1.a")])
    assert "was reduced for few loads" in dict(whole.log["plan"])["error"]


def test_ports_of_all_kinds_are_claimed(tmp_path: Path) -> None:
    """Forces, moments, gravity and pressure; motions, turns, displacements and stresses: all of H,
    and each kind of outputs from each of inputs, against both full bodies tied together."""
    materials = {
        "materials": {"steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0}},
        "regions": {"all": {"material": "steel"}},
        "damping": {"alpha": 30.0, "beta": 1e-6},
        "loads": {
            "gravity": {"type": "acceleration"},
            "gas": {"type": "pressure", "nodes": "side"},
        },
    }
    mesh = sided("tetra10", counts=(6, 2, 2))
    one = materials | {
        "supports": {"foot": {"nodes": "start"}},
        "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
        "outputs": {"spot": {"type": "stress", "nodes": [40, 41]}},
    }
    two = materials | {
        "interfaces": {
            "start": {"coupling": "rigid", "nodes": "start"},
            "end": {"coupling": "distributing", "nodes": "end"},
        },
        "outputs": {"there": {"nodes": [77]}, "spot": {"type": "stress", "nodes": [50]}},
    }
    parts, systems = {}, []
    for name, content in (("one", one), ("two", two)):
        import_description(content, name, tmp_path / f"{name}.h5", mesh=mesh)
        parts[name] = flexgram.reduce(tmp_path / f"{name}.h5", (100, 4000), 1e-7)
        systems.append(body_system(tmp_path / f"{name}.h5"))
    whole = couple(parts, [Joint("one.end", "two.start")])
    assert whole.kind == "certified", dict(whole.log["plan"])["error"]
    assert {
        "stress from moment",
        "stress from acceleration",
        "displacement from pressure",
        "rotation from force",
        "displacement from force",
    } <= set(whole.kinds)
    claims = dict(zip(whole.kinds, whole.by_kind, strict=True))
    K, M, D, B, C = (
        scipy.linalg.block_diag(*(np.asarray(x) for x in matrices))
        for matrices in (
            [s.K.toarray() for s in systems],
            [s.M.toarray() for s in systems],
            [(s.alpha * s.M + s.beta * s.K).toarray() for s in systems],
            [s.B for s in systems],
            [s.C for s in systems],
        )
    )
    inputs = [f"{n}.{p}" for n, m in parts.items() for p in m.inputs]
    outputs = [f"{n}.{p}" for n, m in parts.items() for p in m.outputs]
    ties = np.array(
        [
            B[:, inputs.index(f"one.end.{p}")] - B[:, inputs.index(f"two.start.{p}")]
            for p in PORTS.values()
        ]
    )
    rows = [outputs.index(name) for name in whole.outputs]
    columns = [inputs.index(name) for name in whole.inputs]
    # In long doubles: doubles lose more than is claimed.
    K, M, D = (a.astype(np.longdouble) for a in (K, M, D))
    stiff = float(abs(K).max())
    loads = np.vstack([B[:, columns], np.zeros((6, len(columns)))]).astype(np.clongdouble)
    rng = np.random.default_rng(4)
    for w in 2 * np.pi * rng.uniform(100, 4000, 4):
        x = np.clongdouble(w)
        A = np.block(
            [[K + 1j * x * D - x * x * M, stiff * ties.T], [stiff * ties, np.zeros((6, 6))]]
        )
        H = (C[rows] @ exactly(A, loads)[: len(K)]).astype(complex)
        E = H - whole.transfer(w)
        assert np.linalg.norm(E) <= whole.whole_error * np.linalg.norm(H)
        for kind, claim in claims.items():
            output, input_ = kind.split(" from ")
            block = np.ix_(ports_of(whole.outputs, output), ports_of(whole.inputs, input_))
            assert np.linalg.norm(E[block]) <= claim * np.linalg.norm(H[block]), kind
    assert max(claims.values()) < 1


def test_what_is_claimed_and_what_not() -> None:
    """Of outputs alone too; interfaces measure what they drive, and add nothing at once to outputs;
    two with nothing in common are not joined; dampers at 0 Hz."""
    rng = np.random.default_rng(9)
    K, M, B, names, alpha, beta = random_body(rng, 6)
    matrices = sp.csr_matrix(K), sp.csr_matrix(M)
    row = np.zeros((1, len(K)))
    row[0, 7] = 1.0
    more = Matrices(
        *matrices,
        B,
        C=np.vstack([B.T, row]),
        inputs=names,
        outputs=[*names, "c.ux"],
        alpha=alpha,
        beta=beta,
    )
    other = reduced(random_body(rng, 6), 1e-5)
    rod = flexgram.reduce(more, BAND, 1e-5)
    whole = couple({"p0": rod, "p1": other}, [Joint("p0.b", "p1.a")])
    assert "p0.c.ux" in whole.outputs and whole.kind == "certified"
    rod.feedthrough[6, 4] = 1.0
    with pytest.raises(BodyError, match=r"p0\.c\.ux .* at once, .* leave it out"):
        couple({"p0": rod, "p1": other}, [Joint("p0.b", "p1.a")])
    turned = Matrices(*matrices, B, C=-B.T, inputs=names, outputs=names, alpha=alpha, beta=beta)
    with pytest.raises(BodyError, match="is not what the input drives"):
        couple({"p0": flexgram.reduce(turned, BAND, 1e-3), "p1": other}, [Joint("p0.b", "p1.a")])
    some = Matrices(*matrices, B[:, :2], inputs=["a.fx", "b.fy"], alpha=alpha, beta=beta)
    two = flexgram.reduce(some, BAND, 1e-3)
    with pytest.raises(BodyError, match=r"no direction in common \(x and y\)"):
        couple({"p0": two, "p1": two}, [Joint("p0.a", "p1.b")])
    held = Matrices(*matrices, B, inputs=names, alpha=alpha, beta=beta)
    still = flexgram.reduce(held, (0.0, 0.6), 1e-4)
    said = verdict(
        {"p0": still, "p1": still}, [Joint("p0.b", "p1.a", damping={"x": 0.3})], omega=[0.0]
    )
    assert np.isfinite(said.bound[0])
