"""Parameters: stiffness that is known between two numbers, as terms (p - least) T, certified with
several values of p from one factorisation."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse as sp
from test_viscoelastic_materials import mounted
from ways import in_every_way

import flexgram
from conftest import body_system, message, run
from flexgram import BodyError, Matrices, ReducedModel
from flexgram.assembly.couple import couple
from flexgram.exporters import export
from flexgram.model.damped_modes import sensitivities
from flexgram.pictures import figures
from referee import System, relative_error

TWO_PI = 2 * np.pi
BAND = (0.002, 0.05)
DAMPING = {"alpha": 1e-3, "beta": 0.02, "eta": 1e-3}
LAW = flexgram.parameter(1.0, 4.0, 1.5, loss=0.05)
STIFF = flexgram.parameter(0.0, 2.0, slope=0.5)


def springs(n: int, first: int, last: int) -> Any:
    ends = np.zeros((n, n))
    for k in range(first, last):
        ends[k : k + 2, k : k + 2] += [[1.0, -1.0], [-1.0, 1.0]]
    return sp.csc_matrix(ends)


def chain(n: int = 60, **laws: Any) -> dict[str, Any]:
    """Springs between masses, of which a third, ``soft``, and a sixth, ``bolt``, may be stiffer."""
    K = (springs(n, 0, n - 1) + sp.coo_matrix(([1.0], ([0], [0])), shape=(n, n))).tocsc()
    parts = {"soft": springs(n, n // 2, n - n // 6), "bolt": springs(n, 10, 10 + n // 6)}
    return {"K": K, "M": sp.identity(n, format="csc"), "B": np.eye(n)[:, [n - 1, n // 3]]} | {
        "terms": {name: (parts[name], law) for name, law in laws.items()}
    }


def with_values(a: dict[str, Any], damping: dict[str, float], **values: float) -> System:
    """The full body with these values, for the referee, by the definition of a parameter."""
    K, S = a["K"].toarray(), np.zeros(a["K"].shape)
    for name, value in values.items():
        T, law = a["terms"][name]
        stiffer = law.slope * (value - law.least) * T.toarray()
        K, S = K + stiffer, S + law.loss * stiffer
    return System(K, a["M"].toarray(), a["B"], S=S, **damping)


def small(rom: ReducedModel) -> System:
    s = rom.system
    assert not s.terms
    return System(s.K, s.M, s.B, s.C, s.D, S=s.S, eta=s.eta)


def frequencies(rom: ReducedModel) -> Iterator[float]:
    """Of the band: spread, and at the resonances of the body with its values."""
    rng = np.random.default_rng(2)
    yield from TWO_PI * np.concatenate([rng.uniform(*BAND, 30), BAND])
    yield from (w for w in rom.modes if TWO_PI * BAND[0] <= w <= TWO_PI * BAND[1])


@pytest.mark.parametrize("ranks", [2])
def test_one_parameter_is_certified_with_its_values(ranks: int, tmp_path: Path) -> None:
    """Below the claim against extended precision with each of the values, from a file, from its
    medium model, by pod; near it between them."""
    a = chain(soft=LAW)
    body = tmp_path / "body.h5"
    flexgram.write_matrices(body, **a, **DAMPING)
    said, rom, again, sampled = in_every_way(body, BAND, 16, ranks)
    assert "soft from 1 to 4 (1.5)\n" in said
    assert "with the least values of the parameters, 6 with others" in said
    assert "the claim is to hold with 6 combinations of the parameters' values" in said
    assert "everywhere in the band with each of 6 combinations of the parameters' values" in said
    assert np.allclose(rom.claim.parameter_values[:, 0], [1.5, *np.geomspace(1, 4, 5)], rtol=1e-12)
    assert rom.claim.parameters == ["soft"] and 0 < rom.claim.between_values <= 1e-6
    attained = 0.0
    for (value,) in rom.claim.parameter_values:
        full = with_values(a, DAMPING, soft=value)
        for model in (rom.at(soft=value), again.at(soft=value)):
            assert model.kind == "certified" and f"soft = {value:g}" in model.claim.label
            for omega in frequencies(model):
                error = relative_error(full, small(model), omega)
                assert error <= model.certified_error <= 1e-6
                attained = max(attained, error)
    assert attained > 0.2 * rom.certified_error
    for value in (1.2, 1.7, 2.4, 3.5):
        full, model = with_values(a, DAMPING, soft=value), rom.at(soft=value)
        assert model.kind == "estimated" and "but with 6 values of soft" in model.claim.label
        assert max(relative_error(full, small(model), w) for w in frequencies(model)) <= 2e-6
    again.at(soft=3.0).save(tmp_path / "three.h5")
    sampled.at(soft=3.0).save(tmp_path / "pod.h5")  # whose claim knows no values
    for model in (ReducedModel.load(tmp_path / name) for name in ("three.h5", "pod.h5")):
        assert not model.system.parameters and model.claim.chosen_names == ["soft"]
        assert model.kind == "estimated" and "soft = 3" in model.claim.label
    A = (again, ReducedModel.load(tmp_path / "three.h5"))
    H = [model.at(**({"soft": 3.0} if model is again else {})).transfer(0.2) for model in A]
    assert np.allclose(*H, rtol=1e-12)
    full, now = with_values(a, DAMPING, soft=1.5), sampled.at()
    for omega in frequencies(now):
        H = full.transfer(omega).astype(complex)
        assert np.linalg.norm(now.transfer(omega) - H) < 0.1 * np.linalg.norm(H)
        assert np.allclose(sampled.transfer(omega), now.transfer(omega), rtol=1e-9)


def test_light_damping_beside_a_wide_box() -> None:
    """Resonances that move far and are narrow: the softest body's modes do not prove the claim."""
    a = chain(150, soft=flexgram.parameter(1.0, 4.0, 1.5))
    options = {"mor_parameter_values": 3}
    rom = flexgram.reduce(Matrices(**a, eta=5e-4), (0.0005, 0.02), 1e-2, options=options)
    assert rom.kind == "certified" and not rom.provenance.warnings
    for (value,) in rom.claim.parameter_values:
        full, model = with_values(a, {"eta": 5e-4}, soft=value), rom.at(soft=value)
        resonances = model.modes[model.modes <= TWO_PI * 0.02]
        for omega in (*resonances, *(1.0002 * resonances[:-1]), TWO_PI * 0.02):
            assert relative_error(full, small(model), omega) <= rom.certified_error


def test_the_claim_follows_the_box() -> None:
    """A body whose least value alone is claimed is smaller, and is worse elsewhere; two parameters
    are claimed with all combinations."""
    a = chain(soft=flexgram.parameter(1.0, 20.0, 1.0))
    one = flexgram.reduce(Matrices(**a, **DAMPING), BAND, 1e-5, parameter_values=1)
    all_of_it = flexgram.reduce(Matrices(**a, **DAMPING), BAND, 1e-5)
    assert one.met and all_of_it.met and one.order < all_of_it.order
    assert one.claim.parameter_values.tolist() == [[1.0]]
    worst = {}
    for name, rom in (("one", one), ("all", all_of_it)):
        model = rom.at(soft=20.0)
        full = with_values(a, DAMPING, soft=20.0)
        worst[name] = max(relative_error(full, small(model), w) for w in frequencies(model))
    assert worst["all"] <= all_of_it.certified_error <= 1e-5 < worst["one"]
    a = chain(soft=LAW, bolt=STIFF)
    rom = flexgram.reduce(Matrices(**a, **DAMPING), BAND, 1e-4)
    values = rom.claim.parameter_values
    assert rom.met and len(values) == 10 and rom.claim.parameters == ["soft", "bolt"]
    for soft, bolt in values:
        model = rom.at(bolt=bolt, soft=soft)
        full = with_values(a, DAMPING, bolt=bolt, soft=soft)
        for omega in list(frequencies(model))[::3]:
            assert relative_error(full, small(model), omega) <= rom.certified_error <= 1e-4


def test_values_of_a_reduced_body(tmp_path: Path) -> None:
    """``at`` gives the body of the same H, in memory, in files and by the command; the claim says
    what it is worth."""
    a = chain(soft=LAW, bolt=STIFF)
    rom = flexgram.reduce(Matrices(**a, **DAMPING), BAND, 1e-3, at="soft=2", parameter_values=2)
    assert rom.system.parameters["soft"].value == 2.0
    source, target = tmp_path / "a.rom.h5", tmp_path / "b.rom.h5"
    rom.save(source)
    loaded = ReducedModel.load(source)
    assert loaded.system.parameters == rom.system.parameters
    said = run("info", source).out
    assert "each of 5 values of soft, bolt" in said
    out = run("at", source, "soft=3", "bolt=2", "-o", target).out
    assert "estimated, not proved with soft = 3, bolt = 2" in out
    one, read = loaded.at(soft=3.0, bolt=2.0), ReducedModel.load(target)
    assert not read.system.parameters and np.allclose(read.modes, one.modes, rtol=1e-12)
    assert read.claim.label == one.claim.label and read.kind == "estimated"
    one.save(target)
    assert np.array_equal(ReducedModel.load(target).K, one.K)
    for omega in (0.1, 0.2, 0.3):
        laws = {t.name: t.law.with_value({"soft": 3.0, "bolt": 2.0}[t.name], t.name)
                for t in rom.system.terms}  # fmt: skip
        A = rom.K * (1 + 1j * rom.system.eta) + 1j * omega * rom.system.D - omega**2 * rom.M
        A = A + sum(complex(laws[t.name].at(omega)) * t.matrix for t in rom.system.terms)
        H = rom.system.C @ np.linalg.solve(A, rom.B)
        for model in (one, read):
            assert np.allclose(model.transfer(omega), H, rtol=1e-11)
    known = loaded.at(soft=4.0, bolt=0.0)
    assert known.kind == "certified" and known.certified_error == rom.certified_error
    with pytest.raises(BodyError, match=r"soft is no parameter.*none"):
        known.at(soft=1.0)
    with pytest.raises(BodyError, match="soft = 5: the body knows soft from 1 to 4"):
        loaded.at(soft=5.0)
    with pytest.raises(BodyError, match="hard is no parameter of the body; it has"):
        loaded.at(hard=5.0)
    assert "expected NAME=VALUE" in message(run("at", source, "soft", "-o", target, expect=1))
    assert "knows soft from" in message(run("at", source, "soft=9", "-o", target, expect=1))


def test_present_values_in_time_and_in_exports(tmp_path: Path) -> None:
    """Without a word a parameter has its present value: state spaces, simulations, exports."""
    a = chain(soft=flexgram.parameter(1.0, 4.0, 2.0))
    viscous = {"alpha": 1e-3, "beta": 0.02}
    rom = flexgram.reduce(Matrices(**a, **viscous), BAND, 1e-3)
    now = rom.at()
    assert not now.system.terms and not rom.system.loss
    assert all(
        np.array_equal(x, y) for x, y in zip(rom.state_space(), now.state_space(), strict=True)
    )
    assert np.array_equal(rom.poles(), now.poles())
    t = np.linspace(0, 50, 201)
    push = np.ones((201, 2))
    assert np.array_equal(rom.simulate(push, t)[0], now.simulate(push, t)[0])
    for format in ("mat", "octave", "state-space"):
        one = export(rom, tmp_path / "one", format).read_bytes()
        other = export(now, tmp_path / "two", format).read_bytes()
        assert len(one) == len(other)  # but for names and times
    assert list(couple({"a": rom}, []).system.parameters) == ["a.soft"]


def test_resonances_move_with_the_parameter() -> None:
    """Of a lightly damped body the claim holds on the resonances of each value; a parameter with a
    loss factor may be the only damping of a body, and there must be some."""
    a = chain(soft=flexgram.parameter(1.0, 4.0, 2.0))
    rom = flexgram.reduce(Matrices(**a, eta=1e-4), BAND, 1e-3, parameter_values=3)
    assert rom.met and rom.kind == "certified"
    for (value,) in rom.claim.parameter_values:
        full, model = with_values(a, {"eta": 1e-4}, soft=value), rom.at(soft=value)
        for omega in frequencies(model):
            assert relative_error(full, small(model), omega) <= rom.certified_error <= 1e-3
    with pytest.raises(BodyError, match="needs some damping"):
        flexgram.reduce(Matrices(**a), BAND, 1e-3)
    lossy = chain(soft=flexgram.parameter(1.0, 4.0, 2.0, loss=0.1))
    damped = flexgram.reduce(Matrices(**lossy), BAND, 1e-3, parameter_values=3)
    assert damped.met and damped.kind != "estimated" and damped.system.loss == "S, by material"
    assert ("damping", "soft (η = 0.1)") in damped.provenance.plan


def test_envelope_and_sensitivities(tmp_path: Path) -> None:
    """The envelope holds the response with any value, and the sensitivities of the frequencies are
    their differences; the report has both, also of a body with values."""
    a = chain(soft=LAW, bolt=flexgram.parameter(1.0, 2.0))
    rom = flexgram.reduce(Matrices(**a, **DAMPING), BAND, 1e-3, parameter_values=2)
    omega = TWO_PI * np.linspace(*BAND, 40)
    least, largest = figures.envelope(rom, omega)
    for soft, bolt in ((1.0, 1.0), (4.0, 2.0), (2.0, 2 ** (2 / 3))):
        size = np.abs(rom.at(soft=soft, bolt=bolt).transfer(omega))
        assert np.all(size >= least * (1 - 1e-9)) and np.all(size <= largest * (1 + 1e-9))
    found, now = sensitivities(rom.system), {n: p.value for n, p in rom.system.parameters.items()}
    for name in ("soft", "bolt"):
        up, down = (rom.at(**{**now, name: now[name] * (1 + h)}) for h in (1e-5, -1e-5))
        slope = (up.modes[:6] - down.modes[:6]) / (2e-5 * rom.at().modes[:6])
        assert np.allclose(found[name][:6], slope, rtol=1e-4, atol=1e-7)
    source = tmp_path / "a.rom.h5"
    rom.save(source)
    rom.at(soft=3.0).save(tmp_path / "b.rom.h5")
    for name in ("a", "b"):
        run("report", tmp_path / f"{name}.rom.h5", "-o", tmp_path / f"{name}.html")
    page = (tmp_path / "a.html").read_text()
    assert "<th>bolt</th><th>soft</th>" in page and "soft = 3" in (tmp_path / "b.html").read_text()
    run("plot", source, "--figure", "transfer", "-o", tmp_path / "a.svg")
    assert "any bolt, soft" in (tmp_path / "a.svg").read_text()


def test_what_is_refused(tmp_path: Path) -> None:
    """Numbers that do not rise, values outside, names that are none, too many combinations."""
    for numbers, words in (
        ((2.0, 1.0), "must rise"),
        ((1.0, 2.0, 3.0), "value 3 must be from 1 to 2"),
        ((1.0, np.inf), "must rise"),
    ):
        with pytest.raises(BodyError, match=words):
            flexgram.parameter(*numbers)
    with pytest.raises(BodyError, match="slope must be positive"):
        flexgram.parameter(1.0, 2.0, slope=-1.0)
    body = tmp_path / "body.h5"
    flexgram.write_matrices(body, **chain(soft=LAW, bolt=STIFF))
    asked = ("reduce", "-body", body, "-mor_band_hz", "0.002,0.05", "-mor_out", tmp_path / "r.h5")
    for option, value, words in (
        ("-mor_at", "sofft=2", "did you mean soft?"),
        ("-mor_at", "soft=9", "least 1, value 9, most 4 must rise"),
        ("-mor_at", "soft", "NAME=VALUE"),
        ("-mor_parameter_values", "40", "1601 combinations of values of 2 parameters"),
        ("-mor_parameter_values", "-1", "0 to 100"),
    ):
        assert words in message(run(*asked, option, value, expect=1))
    with h5py.File(body, "r+") as file:
        file["terms/soft"].attrs["value"] = [7.0]
    assert "file" in message(run(*asked, expect=1)) and "soft" in message(run(*asked, expect=1))
    plain = tmp_path / "plain.h5"
    flexgram.write_matrices(plain, **chain())
    again = ("reduce", "-body", plain, "-mor_band_hz", "0.002,0.05", "-mor_at", "soft=2")
    assert "the body has no parameters" in message(run(*again, expect=1))


@pytest.mark.parametrize("given", ["E", "stiffness"])
def test_a_material_known_between_two_numbers(given: str, tmp_path: Path) -> None:
    """With each value the claim holds against the body that is assembled with that modulus; the
    loss factors of both materials, α and β go along."""
    damping = {"damping": {"alpha": 2.0, "beta": 1e-6}}
    rubber = {"E": 5e7, "loss_factor": 0.2}
    box = {"E": [2.5e7, 1e8]} if given == "E" else {"stiffness": [0.5, 2.0]}
    name, unit = ("E_rubber", 1.0) if given == "E" else ("stiffness_rubber", 1 / 5e7)
    body = mounted(tmp_path / "a.h5", {**rubber, "parameter": box}, **damping)
    rom = flexgram.reduce(body, (5, 1500), 1e-4)
    assert rom.met and rom.kind == "certified" and name in rom.system.parameters
    for E in (2.5e7, 5e7, 1e8):
        own = mounted(tmp_path / f"{E:g}.h5", {**rubber, "E": E}, **damping)
        full, model = body_system(own), rom.at(**{name: E * unit})
        assert model.kind == "certified"
        for hertz in (5.0, 130.0, 400.0, 777.0, 1500.0):
            H = full.transfer(TWO_PI * hertz).astype(complex)
            away = np.linalg.norm(model.transfer(TWO_PI * hertz) - H)
            assert away <= rom.certified_error * np.linalg.norm(H)
    with pytest.raises(BodyError, match="must rise from a positive number, with E of the material"):
        mounted(tmp_path / "b.h5", {**rubber, "parameter": {"E": [6e7, 1e8]}})
    with pytest.raises(BodyError, match=r"give E: \[from, to\], stiffness"):
        mounted(tmp_path / "b.h5", {**rubber, "parameter": {}})
