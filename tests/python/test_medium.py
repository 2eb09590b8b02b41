"""Two steps are two calls: certify once, cut often; the file between them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse as sp
from test_continuum import chain, chain_modes

import flexgram
from conftest import message, program, rom_matrices, rom_system, run
from flexgram import BodyError, write_matrices
from referee import System, relative_error

SAME = 1e-9  # of H, for the same model up to rounding


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float, float]:
    """A damped chain of 80 masses with three ports; its file and a band [Hz] of nine modes."""
    folder = tmp_path_factory.mktemp("medium")
    K, M, B, _ = chain(80, "three")
    omega = chain_modes(80)
    names = ["a.fx", "a.mx", "b.fx"]
    write_matrices(
        folder / "body.h5", K, M, B, alpha=2e-2 * omega[0], beta=1e-4 / omega[9], inputs=names
    )
    return folder / "body.h5", 0.2 * omega[0] / (2 * np.pi), omega[8] / (2 * np.pi)


@pytest.fixture(scope="module")
def medium(body: tuple[Path, float, float]) -> Path:
    path, first, last = body
    out = path.parent / "medium.h5"
    run(
        "certify",
        "-body",
        path,
        "-mor_band_hz",
        f"{first!r},{last!r}",
        "-mor_tol",
        "1e-8",
        "-mor_medium_out",
        out,
    )
    return out


def distance(a: Path | Any, b: Path | Any, band: tuple[float, float]) -> float:
    """Largest relative difference of H of two reduced bodies over the band [Hz]."""
    systems: list[System] = []
    for rom in (a, b):
        if isinstance(rom, Path):
            systems.append(rom_system(rom_matrices(rom)))
        else:
            systems.append(System(rom.K, rom.M, rom.B, rom.C, rom.D, eta=rom.eta))
    return max(
        relative_error(systems[0], systems[1], w) for w in 2 * np.pi * np.linspace(*band, 37)
    )


REQUESTS: dict[str, list[str]] = {
    "1e-1": ["-mor_tol", "1e-1"],
    "1e-3": ["-mor_tol", "1e-3"],
    "1e-6": ["-mor_tol", "1e-6"],
    "1e-8": ["-mor_tol", "1e-8"],
    "whole": ["-mor_tol", "1e-4", "-mor_tol_of", "whole"],
    "band": ["-mor_tol", "1e-4", "-mor_tol_relative_to", "band"],
    "rule": [],
    "order": ["-mor_order", "12"],
    "modal": ["-mor_method", "modal", "-mor_order", "9"],
    "craig_bampton": ["-mor_method", "craig_bampton"],
    "krylov": ["-mor_method", "krylov", "-mor_moments", "3"],
    "irka": ["-mor_second_stage", "irka", "-mor_order", "11"],
}


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("name", REQUESTS)
def test_a_cut_equals_the_reduction(
    tmp_path: Path, body: tuple[Path, float, float], medium: Path, name: str, ranks: int
) -> None:
    path, *band = body
    asked = REQUESTS[name]
    run(
        "reduce",
        "-body",
        path,
        "-mor_band_hz",
        f"{band[0]!r},{band[1]!r}",
        *asked,
        "-mor_out",
        tmp_path / "a.h5",
    )
    run("cut", "-medium", medium, *asked, "-mor_out", tmp_path / "b.h5", ranks=ranks)
    with h5py.File(tmp_path / "a.h5") as a, h5py.File(tmp_path / "b.h5") as b:
        assert a["K"].shape == b["K"].shape
        assert a["V"].shape == b["V"].shape
        for key in ("worst", "whole"):
            assert np.isclose(a["error"].attrs[key], b["error"].attrs[key], rtol=1e-3), key
        assert a["error"].attrs["kind"] == b["error"].attrs["kind"] == "certified"
    assert distance(tmp_path / "a.h5", tmp_path / "b.h5", band) < SAME  # type: ignore[arg-type]


def test_ports_and_bands_may_be_fewer(
    tmp_path: Path, body: tuple[Path, float, float], medium: Path
) -> None:
    """A cut with some ports in a part of the band: certified for those, against the full body."""
    path, first, last = body
    part = f"{1.5 * first!r},{0.6 * last!r}"
    out = tmp_path / "fewer.h5"
    run(
        "cut",
        "-medium",
        medium,
        "-mor_tol",
        "1e-5",
        "-mor_band_hz",
        part,
        "-mor_inputs",
        "a.fx,b.fx",
        "-mor_outputs",
        "a.mx",
        "-mor_out",
        out,
    )
    with h5py.File(out) as file:
        assert list(file["B"].attrs["names"]) == ["a.fx", "b.fx"]
        assert list(file["C"].attrs["names"]) == ["a.mx"]
        claim = dict(file["error"].attrs)
    K, M, B, _ = chain(80, "three")
    with h5py.File(path) as file:
        damping = {key: float(file.attrs[key]) for key in ("alpha", "beta")}
    full = System(K, M, B[:, [0, 2]], B[:, [1]].T, **damping)
    rom = rom_system(rom_matrices(out))
    grid = 2 * np.pi * np.linspace(1.5 * first, 0.6 * last, 400)
    truth = max(relative_error(full, rom, w) for w in grid)
    assert truth <= claim["whole"] <= 1e-5 and claim["met"] == 1


def test_messages(tmp_path: Path, body: tuple[Path, float, float], medium: Path) -> None:
    path, first, last = body
    out = tmp_path / "rom.h5"

    def refused(*arguments: Any) -> str:
        return message(run("cut", *arguments, "-mor_out", out, expect=1))

    assert "no medium model" in refused()
    assert "no medium model" in refused("-medium", path)
    assert "no such" in refused("-medium", tmp_path / "none.h5").lower()
    assert "--band" in refused("-medium", medium, "-mor_band_hz", f"{first},{2 * last}")
    assert "--shifts" in refused(
        "-medium", medium, "-mor_method", "krylov", "-mor_shifts_hz", f"{3 * last}"
    )
    assert "--cutoff" in refused("-medium", medium, "-mor_method", "modal", "-mor_order", "40")
    assert "pod" in refused("-medium", medium, "-mor_method", "pod")
    assert "replace the input" in message(
        run("cut", "-medium", medium, "-mor_out", medium, expect=1)
    )
    tight = run("cut", "-medium", medium, "-mor_tol", "1e-12", "-mor_out", out, expect=2)
    assert "is not met" in tight.out
    assert not list(tmp_path.glob("*.part"))


def test_a_damaged_file_is_refused(tmp_path: Path, medium: Path) -> None:
    """Every dataset shortened and every number spoilt in turn: an error, never a wrong result."""
    with h5py.File(medium) as file:
        names: list[str] = []
        file.visititems(lambda n, x: names.append(n) if isinstance(x, h5py.Dataset) else None)
    names = [n for n in names if not n.startswith(("dofs", "nodes"))]
    assert len(names) > 20
    for name in names:
        copy = tmp_path / "damaged.h5"
        copy.write_bytes(medium.read_bytes())
        with h5py.File(copy, "r+") as file:
            whole = file[name][()]
            del file[name]
            file[name] = whole[:-1] if len(whole) > 1 else np.zeros(3)
        result = run(
            "cut", "-medium", copy, "-mor_tol", "1e-3", "-mor_out", tmp_path / "r.h5", expect=1
        )
        assert "damaged" in message(result), name


def test_without_the_basis(tmp_path: Path, body: tuple[Path, float, float]) -> None:
    path, *band = body
    small = tmp_path / "small.h5"
    run(
        "certify",
        "-body",
        path,
        "-mor_band_hz",
        f"{band[0]!r},{band[1]!r}",
        "-mor_tol",
        "1e-6",
        "-mor_medium_out",
        small,
        "-mor_medium_basis",
        "no",
    )
    run("cut", "-medium", small, "-mor_tol", "1e-4", "-mor_out", tmp_path / "rom.h5", ranks=2)
    with h5py.File(tmp_path / "rom.h5") as file:
        assert "V" not in file
    rom = flexgram.ReducedModel.load(tmp_path / "rom.h5")
    assert rom.met and rom.V.size == 0
    assert "--medium-basis" in message(
        run(
            "cut",
            "-medium",
            small,
            "-mor_inner_product",
            "euclidean",
            "-mor_out",
            tmp_path / "x.h5",
            expect=1,
        )
    )


def test_free_body_with_frame(tmp_path: Path, rack: Path) -> None:
    """The integrals of a floating frame and the dofs come through the medium file."""
    band = (10.0, 300.0)
    run(
        "reduce",
        "-body",
        rack,
        "-mor_band_hz",
        "10,300",
        "-mor_tol",
        "1e-3",
        "-mor_out",
        tmp_path / "a.h5",
        "-mor_medium_out",
        tmp_path / "m.h5",
    )
    run("cut", "-medium", tmp_path / "m.h5", "-mor_tol", "1e-3", "-mor_out", tmp_path / "b.h5")
    run(
        "reduce",
        "-body",
        rack,
        "-mor_band_hz",
        "10,300",
        "-mor_tol",
        "1e-3",
        "-mor_out",
        tmp_path / "c.h5",
    )
    assert distance(tmp_path / "a.h5", tmp_path / "b.h5", band) < SAME
    assert distance(tmp_path / "c.h5", tmp_path / "b.h5", band) < SAME
    with h5py.File(tmp_path / "c.h5") as c, h5py.File(tmp_path / "b.h5") as b:
        assert np.isclose(c["frame"].attrs["mass"], b["frame"].attrs["mass"], rtol=1e-12)
        for name in ("M_er", "gyroscopic", "inertia_first", "inertia_second"):
            size = np.abs(c["frame"][name][:]).max()
            # Up to the signs of the basis vectors.
            assert np.allclose(
                np.abs(c["frame"][name][:]), np.abs(b["frame"][name][:]), atol=1e-6 * size
            ), name
        for name in ("dofs/node", "dofs/component", "nodes/position"):
            assert np.array_equal(c[name][:], b[name][:])


def test_python(tmp_path: Path, body: tuple[Path, float, float], medium: Path) -> None:
    path, *band = body
    held = flexgram.certify(path, band_hz=band, tol=1e-8)
    assert held.reached and held.order < 80 and "certified to" in repr(held)
    assert held.inputs == ["a.fx", "a.mx", "b.fx"]
    whole = flexgram.reduce(path, band_hz=band, tol=1e-4)
    rom = held.reduce(tol=1e-4)
    assert rom.order == whole.order and distance(rom, whole, band) < SAME  # type: ignore[arg-type]
    fewer = held.reduce(tol=1e-4, inputs=["a"], outputs=["b"], band_hz=(band[0], 0.5 * band[1]))
    assert fewer.inputs == ["a.fx", "a.mx"] and fewer.outputs == ["b.fx"] and fewer.met
    held.save(tmp_path / "m.h5")
    again = flexgram.Medium.load(tmp_path / "m.h5")
    assert again.order == held.order and again.has_basis
    assert distance(again.reduce(tol=1e-4), rom, band) < SAME  # type: ignore[arg-type]
    rom.save(str(tmp_path / "rom.h5"))
    assert flexgram.ReducedModel.load(tmp_path / "rom.h5").order == rom.order
    with pytest.raises(BodyError, match="certified up to"):
        held.reduce(tol=1e-4, band_hz=(band[0], 3 * band[1]))
    with pytest.raises(BodyError, match="no medium model"):
        flexgram.Medium.load(path)
    with pytest.warns(UserWarning, match="not met"):
        held.reduce(tol=1e-13)


def test_python_on_two_ranks(tmp_path: Path, body: tuple[Path, float, float]) -> None:
    path, *band = body
    output = program("medium", path, *map(repr, band), tmp_path / "m.h5", ranks=2)
    orders, rows, again = json.loads(output.splitlines()[-1])
    alone = flexgram.certify(path, band_hz=band, tol=1e-7)
    assert orders == [alone.reduce(tol=t).order for t in (1e-2, 1e-4, 1e-6)]
    assert rows == 80 and again == orders[1]


def damped(kind: str) -> Any:
    """Matrices of chains in which the optimal basis is tried: C = B', C != B', a dashpot, free."""
    ports = "transfer" if kind == "other outputs" else "three"
    K, M, B, C = chain(80, ports)
    omega = chain_modes(80)
    D = None
    if kind == "dashpot":
        D = sp.csc_matrix(([0.5], ([30], [30])), shape=(80, 80))
    if kind == "free":
        K = K.tolil()
        K[0, 0] = 1e6
        K = K.tocsc()
    return flexgram.Matrices(K, M, B, D=D, C=C, alpha=2e-2 * omega[0], beta=1e-4 / omega[9])


@pytest.mark.parametrize("kind", ["same", "other outputs", "dashpot", "free"])
def test_optimal_beats_the_gramian(kind: str) -> None:
    """At equal order the optimal basis has a smaller certified error, as the full body confirms."""
    body = damped(kind)
    omega = chain_modes(80)
    band = 0.5 * omega[0] / (2 * np.pi), omega[8] / (2 * np.pi)
    held = flexgram.certify(body, band_hz=band, tol=1e-9)
    dense = [np.asarray(a.todense()) for a in (body.K, body.M)]
    full = System(
        *dense,
        body.B,
        body.C,
        None if body.D is None else body.D.toarray(),
        alpha=body.alpha,
        beta=body.beta,
    )
    for m in (13, 16):
        errors = {}
        for stage in ("gramian", "optimal"):
            rom = held.reduce(order=m, options={"mor_second_stage": stage})
            errors[stage] = rom.certified_error
            assert rom.order == m
            reduced = System(rom.K, rom.M, rom.B, rom.C, rom.D, eta=rom.eta)
            grid = 2 * np.pi * np.linspace(*band, 301)
            assert max(relative_error(full, reduced, w) for w in grid) <= rom.certified_error
        assert errors["optimal"] < 0.6 * errors["gramian"], (kind, m, errors)


@pytest.mark.parametrize("ranks", [1, 2])
def test_optimal_on_the_rack(tmp_path: Path, rack: Path, ranks: int) -> None:
    """Thirty states: the Gramian's basis is certified to 7e-3."""
    out = tmp_path / "rom.h5"
    run(
        "reduce",
        "-body",
        rack,
        "-mor_band_hz",
        "10,500",
        "-mor_order",
        "30",
        "-mor_second_stage",
        "optimal",
        "-mor_out",
        out,
        ranks=ranks,
    )
    with h5py.File(out) as file:
        assert file["error"].attrs["worst"] < 8e-4
        assert file["error"].attrs["kind"] == "certified"
        assert file["frame"].attrs["rigid_modes"] == 6


def test_orders_that_a_method_has(tmp_path: Path, rack: Path) -> None:
    """By the paper's rule rigid modes come on top of what the eigenvalues of the elastic part say;
    irka has no more orders than the Gramian that it starts from."""
    out = tmp_path / "rom.h5"
    job = ["reduce", "-body", rack, "-mor_out", out]
    run(*job, "-mor_band_hz", "10,500", "-mor_method", "whole_axis")
    with h5py.File(out) as file:
        assert file["K"].shape[0] > 30 and file["error"].attrs["worst"] < 0.5
    said = message(
        run(*job, "-mor_band_hz", "100", "-mor_method", "irka", "-mor_order", "80", expect=1)
    )
    assert "irka has orders from 7 to" in said
