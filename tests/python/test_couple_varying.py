"""Assemblies of parts with terms: Prony, tables, parameters; springs known between two numbers."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as sl
import scipy.sparse as sp
from assemblies import BAND, joined_response, random_body

import flexgram
from conftest import run
from flexgram import BodyError, Matrices, ReducedModel
from flexgram.assembly.couple import couple, read_joint, verdict
from flexgram.assembly.joints import Joint
from flexgram.body.laws import Law, Table
from flexgram.body.varying_laws import Parameter

TIES = [Joint("p0.b", "p1.a", ["x", "y", "z"])]
SPRINGS = [Joint("p0.b", "p1.a", stiffness=dict.fromkeys("xyz", 4.0), loss=0.2)]


class Part:
    """A random body whose last third has a term of its own."""

    def __init__(self, rng: np.random.Generator, law: Law | None, eta: float = 0.0) -> None:
        self.K, self.M, self.B, self.names, self.alpha, self.beta = random_body(rng, 6)
        n = len(self.K)
        G = np.zeros((n, n))
        some = slice(2 * n // 3, n)
        G[some, some] = self.K[some, some] / 2
        self.T, self.law, self.eta = G, law, eta

    def reduced(self, tolerance: float = 1e-4, **options: Any) -> ReducedModel:
        terms = {} if self.law is None else {"soft": (sp.csr_matrix(self.T), self.law)}
        body = Matrices(
            sp.csr_matrix(self.K),
            sp.csr_matrix(self.M),
            self.B,
            inputs=self.names,
            alpha=self.alpha,
            beta=self.beta,
            eta=self.eta,
            terms=terms,
        )
        return flexgram.reduce(body, BAND, tolerance, options=options)

    def stiffness(self, w: float, value: float | None = None) -> Any:
        """Of the full body at a frequency, from the definition of each law."""
        damped = 1 + 1j * self.eta + 1j * w * self.beta
        A = self.K * damped + (1j * w * self.alpha - w * w) * self.M
        if isinstance(self.law, Parameter):
            p = self.law.value if value is None else value
            return (
                A + (p - self.law.least) * self.law.slope * (damped + 1j * self.law.loss) * self.T
            )
        return A if self.law is None else A + complex(self.law.at(w)) * self.T


def exact(
    parts: list[Part], joints: list[Joint], inputs: list[str], w: float, values: list[Any]
) -> Any:
    A = sl.block_diag(*(p.stiffness(w, x) for p, x in zip(parts, values, strict=True)))
    names = [f"p{i}.{name}" for i, p in enumerate(parts) for name in p.names]
    keep = [names.index(name) for name in inputs]
    return joined_response(A, sl.block_diag(*(p.B for p in parts)), names, joints, keep, w)


def worst(
    whole: ReducedModel,
    parts: list[Part],
    joints: list[Joint],
    values: list[Any],
    rng: np.random.Generator,
) -> float:
    """Of the relative errors at frequencies that no program was given."""
    errors = []
    for hertz in rng.uniform(*BAND, 25):
        w = 2 * np.pi * float(hertz)
        H = exact(parts, joints, whole.inputs, w, values)
        errors.append(np.linalg.norm(whole.transfer(w) - H) / np.linalg.norm(H))
    return float(max(errors))


@pytest.mark.parametrize("joints", [TIES, SPRINGS], ids=["ties", "springs"])
def test_parts_with_prony_terms(joints: list[Joint], tmp_path: Path) -> None:
    """One part relaxes; the claim holds against the full bodies, and a file keeps the term."""
    rng = np.random.default_rng(11)
    parts = [Part(rng, flexgram.prony([0.5, 0.3], [0.2, 2.0]), eta=0.01), Part(rng, None, eta=0.01)]
    models = {f"p{i}": part.reduced() for i, part in enumerate(parts)}
    whole = couple(models, joints, keep=["p1.a"])
    assert [term.name for term in whole.system.terms] == ["p0.soft"]
    assert whole.kind == "certified" and whole.certified_error < 0.05
    assert 0 < worst(whole, parts, joints, [None, None], rng) <= whole.certified_error
    whole.save(tmp_path / "whole.h5")
    loaded = ReducedModel.load(tmp_path / "whole.h5")
    assert np.array_equal(loaded.transfer(1.0), whole.transfer(1.0))


def table_of(rng: np.random.Generator, steps: float = 1.0, loss: float = 0.3) -> Table:
    """By frequencies in and around the band."""
    w = 2 * np.pi * np.array([0.0, 0.1, 0.17, 0.3, 0.31, 0.5, 1.0])
    storage = np.sort(rng.uniform(0, steps, len(w)))
    return flexgram.table(w, storage, loss * rng.uniform(0.1, 1, len(w)))


@pytest.mark.parametrize("joints", [TIES, SPRINGS], ids=["ties", "springs"])
@pytest.mark.parametrize("other", ["none", "prony", "table"])
def test_parts_with_tables(joints: list[Joint], other: str, tmp_path: Path) -> None:
    """The claim holds against the full bodies, at the table's frequencies too; it is not larger
    than what is claimed at each frequency; a file keeps the tables."""
    rng = np.random.default_rng(16)
    laws = {"none": None, "prony": flexgram.prony([0.5], [0.5]), "table": table_of(rng, 30.0)}
    parts = [Part(rng, table_of(rng), eta=0.01), Part(rng, laws[other])]
    models = {f"p{i}": part.reduced() for i, part in enumerate(parts)}
    whole = couple(models, joints, keep=["p1.a"])
    assert whole.kind == "certified" and whole.certified_error < 0.05
    assert 0 < worst(whole, parts, joints, [None, None], rng) <= whole.certified_error
    seen = np.union1d(2 * np.pi * np.array([0.1, 0.17, 0.3, 0.31, 0.5]), whole.claim.omega)
    at = verdict(models, joints, keep=["p1.a"], omega=seen)
    assert at.bound.max() <= whole.claim.whole * (1 + 1e-9) <= 1.5 * at.bound.max()
    for w, bound in zip(seen, at.bound, strict=True):
        H = exact(parts, joints, whole.inputs, w, [None, None])
        assert np.linalg.norm(whole.transfer(w) - H) <= bound * np.linalg.norm(H)
    whole.save(tmp_path / "whole.h5")
    loaded = ReducedModel.load(tmp_path / "whole.h5")
    assert np.array_equal(loaded.transfer(1.0), whole.transfer(1.0))
    held = couple({"both": loaded}, [Joint("both.p1.b", "ground", ["x"])])
    assert held.order == whole.order - 1 and held.system.terms


def test_a_table_is_a_line_between_its_frequencies() -> None:
    rng = np.random.default_rng(17)
    law = table_of(rng)
    for w in [*rng.uniform(0, 8, 40), *law.omega]:
        value, slope = law.line(w)
        assert abs(value + slope * w - law.at(w)) <= 1e-14
        assert abs(law.at(w)) <= law.largest
    assert flexgram.table([2.0], [1.0], [0.5]).line(3.0) == (1 + 0.5j, 0)


def test_an_assembly_that_relaxes_in_time() -> None:
    """Its state space has the H of the assembly; so has an assembly of it."""
    rng = np.random.default_rng(12)
    models = {f"p{i}": Part(rng, flexgram.prony([0.5], [0.5])).reduced() for i in range(2)}
    whole = couple(models, TIES, keep=["p1.a"])
    A, B, C, D = whole.state_space()
    w = 1.3
    H = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D
    assert np.linalg.norm(H - whole.transfer(w)) <= 1e-10 * np.linalg.norm(H)
    held = couple({"both": whole}, [Joint("both.p1.b", "ground", ["x"])])
    assert len(held.system.terms) == 2 and held.order == whole.order - 1


def test_a_parameter_of_a_part_is_one_of_the_assembly(tmp_path: Path) -> None:
    """Its claim holds with each value that is claimed, and the file keeps the parameter."""
    rng = np.random.default_rng(13)
    law = flexgram.parameter(1.0, 3.0, 2.0, loss=0.05)
    parts = [Part(rng, law, eta=0.02), Part(rng, None)]
    models = {f"p{i}": part.reduced(mor_parameter_values=3) for i, part in enumerate(parts)}
    whole = couple(models, TIES, keep=["p1.a"])
    assert whole.kind == "certified" and whole.certified_error < 0.05
    assert "with each of 4 values of p0.soft" in whole.claim.words
    whole.save(tmp_path / "whole.h5")
    loaded = ReducedModel.load(tmp_path / "whole.h5")
    assert list(loaded.system.parameters) == ["p0.soft"]
    for (value,) in whole.claim.parameter_values:
        at = loaded.at(**{"p0.soft": float(value)})
        assert at.kind == "certified"
        assert worst(at, parts, TIES, [value, None], rng) <= whole.certified_error
    at.save(tmp_path / "at.h5")
    assert np.array_equal(ReducedModel.load(tmp_path / "at.h5").transfer(1.0), at.transfer(1.0))
    assert loaded.at(**{"p0.soft": 1.234}).kind == "estimated"
    present = verdict(models, TIES, keep=["p1.a"], omega=[1.5])
    assert present.bound[0] <= whole.certified_error


def test_springs_known_between_two_numbers() -> None:
    """Two of them: the claim holds at all corners; more than one part varies, too."""
    rng = np.random.default_rng(14)
    parts = [Part(rng, flexgram.parameter(1.0, 2.0), eta=0.05), Part(rng, None, eta=0.01)]
    models = {f"p{i}": part.reduced(mor_parameter_values=2) for i, part in enumerate(parts)}
    springs = {"x": flexgram.parameter(2.0, 8.0, 4.0), "y": 3.0, "z": flexgram.parameter(1.0, 3.0)}
    joint = Joint("p0.b", "p1.a", stiffness=springs, loss=0.1)
    whole = couple(models, [joint], keep=["p1.a"])
    assert sorted(whole.system.parameters) == ["p0.b.x", "p0.b.z", "p0.soft"]
    assert whole.claim.parameter_values.shape == (9, 3)
    assert whole.kind == "certified" and whole.certified_error < 0.05
    names = whole.claim.parameters
    for x, z, soft in product((2.0, 8.0), (1.0, 3.0), (1.0, 2.0)):
        values = {"p0.b.x": x, "p0.b.z": z, "p0.soft": soft}
        at = whole.at(**values)
        assert at.kind == "certified" and at.claim.chosen_names == names
        fixed = [replace(joint, stiffness={"x": x, "y": 3.0, "z": z})]
        assert worst(at, parts, fixed, [soft, None], rng) <= whole.certified_error


def test_a_damper_known_between_two_numbers(tmp_path: Path) -> None:
    """Beside a spring that is, in the same direction; and with a part whose Prony term is of a
    modulus that is a parameter: the claim holds against the full bodies, and a file keeps all."""
    rng = np.random.default_rng(18)
    parts = [Part(rng, flexgram.prony([0.5], [0.5]), eta=0.05), Part(rng, None, eta=0.01)]
    known = flexgram.parameter(1.0, 3.0, 2.0)
    relaxation = parts[0].law
    assert relaxation
    parts[0].law = flexgram.product(known, relaxation)
    models = {f"p{i}": part.reduced(mor_parameter_values=2) for i, part in enumerate(parts)}
    joint = Joint(
        *("p0.b", "p1.a"),
        stiffness={"x": flexgram.parameter(2.0, 8.0), "y": 3.0},
        damping={"x": flexgram.parameter(0.1, 0.4), "z": 0.2},
    )
    whole = couple(models, [joint], keep=["p1.a"])
    assert sorted(whole.system.parameters) == ["p0.b.x", "p0.b.x.damping", "p0.soft"]
    assert whole.kind == "certified" and whole.certified_error < 0.05
    whole.save(tmp_path / "whole.h5")
    said = run("modes", tmp_path / "whole.h5").out
    assert "with p0.b.x = 4, p0.b.x.damping = 0.2, p0.soft = 2" in said
    loaded = ReducedModel.load(tmp_path / "whole.h5")
    for x, damper, soft in product((2.0, 8.0), (0.1, 0.4), (1.0, 3.0)):
        at = loaded.at(**{"p0.b.x": x, "p0.b.x.damping": damper, "p0.soft": soft})
        assert at.kind == "certified"
        fixed = [replace(joint, stiffness={"x": x, "y": 3.0}, damping={"x": damper, "z": 0.2})]
        parts[0].law = flexgram.product(replace(known, value=soft), relaxation)
        assert worst(at, parts, fixed, [None, None], rng) <= whole.certified_error


def test_springs_of_the_command_line() -> None:
    read = read_joint("--spring", "spring", "p0.b=ground:x=1e6..4e6,y=3,loss=0.1")
    assert read.parameters["p0.b.x"] == flexgram.parameter(1e6, 4e6, loss=0.1)
    assert read.stiffness["y"] == 3 and read.complex_stiffness("x") == 2e6 * (1 + 0.1j)
    for text, words in (
        ("p0.b=ground:x=4..1", "two that rise"),
        ("p0.b=ground:x=1..2..3", "two that rise"),
        ("p0.b=ground:x=1,loss=0.1..0.2", "must be one number"),
    ):
        with pytest.raises(BodyError, match=words):
            read_joint("--spring", "spring", text)
    damper = read_joint("--damper", "damper", "p0.b=ground:x=100..400,y=5")
    assert list(damper.parameters) == ["p0.b.x.damping"]
    assert damper.damper("x") == 200 and damper.damper("y") == 5
    assert damper.at({"p0.b.x.damping": 300.0}).damping == {"x": 300.0, "y": 5}


def test_what_assemblies_do_not_take() -> None:
    rng = np.random.default_rng(15)
    models = {"p1": Part(rng, None).reduced(1e-3)}
    spring = Joint("p1.b", "ground", stiffness={"x": flexgram.parameter(1.0, 2.0)})
    with pytest.raises(BodyError, match=r"two parameters of the assembly are named p1\.b\.x"):
        couple({"p1": models["p1"]}, [spring, spring], keep=["p1.b"])
    lossy = Joint("p1.b", "ground", stiffness={"x": flexgram.parameter(1.0, 2.0, loss=0.1)})
    with pytest.raises(
        BodyError, match="x is a stiffness, or a damping: give no slope, and a loss"
    ):
        couple({"p1": models["p1"]}, [lossy], keep=["p1.b"])
