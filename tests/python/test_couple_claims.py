"""What is claimed of assemblies, of which kinds of ports, and what is no assembly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from assemblies import BAND, by_number, exactly, random_body, reduced
from test_mesh_loads import sided

import flexgram
from conftest import body_system
from flexgram import BodyError, ReducedModel
from flexgram.assembly.claim import AssemblyBound
from flexgram.assembly.couple import PORTS, Joint, couple, verdict
from flexgram.assembly.small_gain import errors_of
from flexgram.body.description import import_description
from flexgram.body.matrices import Matrices
from flexgram.simulation.histories import ports_of


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
    part.claim.kind_least = np.zeros(1)
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
        ([Joint("p0.a", "p1.a"), Joint("p0.b", "p1.b")], "and no port is left"),
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


def test_the_part_that_most_of_the_error_is_of() -> None:
    """Reduced to a smaller tolerance it makes the assembly better, the other one does not."""
    rng = np.random.default_rng(17)
    bodies = {name: random_body(rng, 6) for name in ("p0", "p1")}
    joints = [Joint("p0.b", "p1.a", ["x", "y"])]

    def of(tolerances: dict[str, float]) -> AssemblyBound:
        parts = {name: reduced(body, tolerances[name]) for name, body in bodies.items()}
        found = verdict(parts, joints)
        assert ("most of it from part" in found.words) == bool(found.most)
        whole = couple(parts, joints)
        note = dict(whole.provenance.plan).get("note", "")
        assert "reduce" not in note or f"reduce {found.most or 'these'} to" in note
        return found

    def largest(found: AssemblyBound) -> float:
        return float(found.estimate[np.isfinite(found.estimate)].max())

    for coarse, other in (("p0", "p1"), ("p1", "p0")):
        found = of({coarse: 1e-2, other: 1e-4})
        assert found.most == coarse
        assert largest(of({coarse: 1e-4, other: 1e-4})) < 0.1 * largest(found)
        assert largest(of({coarse: 1e-2, other: 1e-6})) > 0.5 * largest(found)


def test_the_first_number_is_that_of_the_worst_kind() -> None:
    found = AssemblyBound(
        *np.full((4, 1), 1e-3), worst=5e-3, by_kind={"displacement from force": 4.5e-2}
    )
    assert found.words.startswith("at most 4.5e-02 at each frequency, everywhere in the band")
    assert "of H as a whole 5.0e-03, of displacement from force 4.5e-02" in found.words
