"""Assemblies of parts with loss factors: of their own (eta), and by material (S)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse as sp
from assemblies import BAND, joined_response, random_body

import flexgram
from flexgram import BodyError, Matrices, ReducedModel
from flexgram.assembly.couple import couple, read_joint
from flexgram.assembly.joints import Joint

JOINTS = [
    [Joint("p0.b", "p1.a", ["x", "y", "z"])],
    [Joint("p0.b", "p1.a", stiffness=dict.fromkeys("xyz", 4.0))],
    [
        Joint("p0.b", "p1.a", ["x"]),
        Joint("p1.a", "ground", stiffness={"y": 2.0}, damping={"z": 0.1}),
    ],
    [Joint("p0.b", "p1.a", stiffness=dict.fromkeys("xyz", 4.0), loss=0.3)],
]


def part(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    """A random body with a loss factor, with one of a third of its coordinates, or both."""
    K, M, B, names, alpha, beta = random_body(rng, 6)
    n = len(K)
    some = np.zeros((n, n))
    some[: n // 3, : n // 3] = K[: n // 3, : n // 3]
    more = {
        "eta": {"eta": float(rng.uniform(0.01, 0.2))},
        "S": {"S": rng.uniform(0.05, 0.3) * some},
        "both": {"eta": 0.02, "S": rng.uniform(0.05, 0.3) * some},
        "none": {},
    }[kind]
    return {"K": K, "M": M, "B": B, "inputs": names, "alpha": alpha, "beta": beta, **more}


def reduced(a: dict[str, Any]) -> ReducedModel:
    matrices = {name: sp.csr_matrix(a[name]) for name in "KMS" if name in a}
    rest = {name: x for name, x in a.items() if name not in "KMS"}
    return flexgram.reduce(Matrices(**matrices, **rest), BAND, 1e-5)


def exact(bodies: list[dict[str, Any]], joints: list[Joint], keep: list[int], w: float) -> Any:
    """H of the assembly of full bodies, each with its own damping."""
    A = sl.block_diag(
        *(
            a["K"] * (1 + 1j * a.get("eta", 0) + 1j * w * a["beta"])
            + 1j * a.get("S", 0 * a["K"])
            + (1j * w * a["alpha"] - w * w) * a["M"]
            for a in bodies
        )
    )
    B = sl.block_diag(*(a["B"] for a in bodies))
    names = [f"p{i}.{name}" for i, a in enumerate(bodies) for name in a["inputs"]]
    return joined_response(A, B, names, joints, keep, w)


def test_a_lossy_spring_is_the_only_damping(tmp_path: Path) -> None:
    """Of parts that have none, by hand and by the command; what is no loss factor is refused."""
    rng = np.random.default_rng(8)
    bodies = [{**part(rng, "none"), "alpha": 0.0, "beta": 0.0} for _ in range(2)]
    models = {f"p{i}": reduced(a) for i, a in enumerate(bodies)}
    joints = [Joint("p0.b", "p1.a", stiffness=dict.fromkeys("xyz", 4.0), loss=0.3)]
    whole = couple(models, joints, keep=["p1.a"])
    names = [f"p{i}.{name}" for i, a in enumerate(bodies) for name in a["inputs"]]
    keep = [names.index(name) for name in whole.inputs]
    for hertz in (0.08, 0.21, 0.43):
        w = 2 * np.pi * hertz
        H = exact(bodies, joints, keep, w)
        assert np.linalg.norm(whole.transfer(w) - H) <= 1e-3 * np.linalg.norm(H)
    assert np.linalg.matrix_rank(whole.system.S) == 3
    read = read_joint("--spring", "spring", "p0.b=p1.a:x=4,y=4,z=4,loss=0.3")
    assert read == joints[0]
    for text, words in (
        ("p0.b=p1.a:loss=0.3", "expected :x=1e6"),
        ("p0.b=p1.a:x=4,loss=-1", "loss"),
    ):
        with pytest.raises(BodyError, match=words):
            read_joint("--spring", "spring", text)
    with pytest.raises(BodyError, match=r"a loss factor, 0\.1, is one of springs"):
        couple(models, [Joint("p0.b", "p1.a", damping={"x": 1.0}, loss=0.1)])


@pytest.mark.parametrize("joints", JOINTS, ids=["ties", "springs", "both", "lossy"])
@pytest.mark.parametrize("kinds", [("eta", "eta"), ("eta", "none"), ("S", "both")], ids="-".join)
def test_losses_stay_with_their_parts(kinds: tuple[str, str], joints: list[Joint]) -> None:
    """The claim holds against the assembly of the full bodies; springs have losses of their own."""
    rng = np.random.default_rng(sum(map(ord, "".join(kinds))) + len(joints))
    bodies = [part(rng, kind) for kind in kinds]
    models = {f"p{i}": reduced(a) for i, a in enumerate(bodies)}
    whole = couple(models, joints, keep=["p1.a"])
    assert whole.system.S.any()
    names = [f"p{i}.{name}" for i, a in enumerate(bodies) for name in a["inputs"]]
    keep = [names.index(name) for name in whole.inputs]
    assert whole.kind == "certified" and whole.certified_error < 0.05
    for hertz in rng.uniform(*BAND, 40):
        w = 2 * np.pi * float(hertz)
        H = exact(bodies, joints, keep, w)
        error = np.linalg.norm(whole.transfer(w) - H) / np.linalg.norm(H)
        assert error <= whole.certified_error


def test_one_loss_factor_of_tied_parts_stays_eta(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    one, two = part(rng, "none"), part(rng, "none")
    models = {f"p{i}": reduced({**a, "eta": 0.03}) for i, a in enumerate((one, two))}
    whole = couple(models, JOINTS[0], keep=["p1.a"])
    assert whole.eta == 0.03 and not whole.system.S.any()
    sprung = couple(models, JOINTS[1], keep=["p1.a"])
    assert sprung.eta == 0 and sprung.system.S.any()
    sprung.save(tmp_path / "whole.h5")
    loaded = ReducedModel.load(tmp_path / "whole.h5")
    assert np.array_equal(loaded.transfer(1.0), sprung.transfer(1.0))
