"""Parameters of materials, regions and springs that relax, damp or are in tables: matrices against
those of the same body with one value."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from test_discrete import beam
from test_viscoelastic_materials import mounted

from conftest import assembled, message, read_sparse, run
from flexgram import BodyError
from flexgram.body.terms import law_of
from flexgram.body.varying_laws import Varying

OMEGA = 2 * np.pi * np.array([0.0, 3.0, 77.0, 1234.0])
PRONY = {"prony": [[0.3, 1e-3], [0.1, 2e-5]]}


def dynamic_stiffness(
    body: Path, ranks: int = 1, values: dict[str, float] | None = None
) -> dict[float, Any]:
    """A(ω) of the matrices that the program assembles, parameters with these values."""
    out = body.with_suffix(".matrices.h5")
    assembled(out, body, ranks)
    left, A = dict(values or {}), {}
    with h5py.File(out) as file:
        of = {n: read_sparse(file, n).toarray() for n in "KMDS" if n in file}
        alpha, beta, eta = (float(file.attrs.get(n, 0)) for n in ("alpha", "beta", "eta"))
        terms = []
        for name, group in file.get("terms", {}).items():
            law = law_of(str(group.attrs["law"]), group.attrs, name)
            if isinstance(law, Varying):
                value = (values or {})[law.parameter(name)]
                law = law.with_value(value, name)
                left.pop(law.parameter(name), None)
            terms.append((law, read_sparse(file, f"terms/{name}").toarray()))
    assert not left
    for w in OMEGA:
        A[w] = of["K"] * (1 + 1j * (eta + beta * w)) + (1j * w * alpha - w * w) * of["M"]
        A[w] = A[w] + 1j * w * of.get("D", 0) + 1j * of.get("S", 0)
        A[w] = A[w] + sum(complex(law.at(w)) * T for law, T in terms)
    return A


def same(one: dict[float, Any], other: dict[float, Any]) -> None:
    for w in OMEGA:
        assert np.abs(one[w] - other[w]).max() <= 1e-12 * np.abs(other[w]).max()


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    "rubber",
    [
        {"E": 4e7, "viscoelastic": PRONY},
        {"E": 4e7, "viscoelastic": {**PRONY, "moduli": "instantaneous"}},
        {"E": 4e7, "viscoelastic": {"prony": {"shear": [[0.2, 1e-3]]}}, "loss_factor": 0.1},
        {"viscoelastic": {"table": {"hz": [0, 2000], "storage": [3e7, 5e7], "loss": [1e6, 9e6]}}},
    ],
    ids=["long-term", "instantaneous", "shear", "table"],
)
def test_a_material_whose_moduli_vary_and_relax(
    rubber: dict[str, Any], ranks: int, tmp_path: Path
) -> None:
    kind = "tetra10" if "loss_factor" in rubber else "hexahedron"
    known = {"parameter": {"stiffness": [0.5, 2.0]}}
    body = mounted(tmp_path / "a.h5", rubber | known, kind=kind)
    for value in (0.5, 1.3, 2.0):
        one = {**rubber}
        if "E" in one:
            one["E"] = value * one["E"]
        else:
            one["viscoelastic"] = {
                "table": {
                    key: list(np.array(x) * (1 if key == "hz" else value))
                    for key, x in rubber["viscoelastic"]["table"].items()
                }
            }
        other = mounted(tmp_path / "b.h5", one, kind=kind)
        same(
            dynamic_stiffness(body, ranks, {"stiffness_rubber": value}),
            dynamic_stiffness(other, ranks),
        )


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_modulus_or_a_loss_factor_between_two_numbers(ranks: int, tmp_path: Path) -> None:
    E = {"E": 4e7, "viscoelastic": PRONY, "parameter": {"E": [3e7, 6e7]}}
    body = mounted(tmp_path / "a.h5", E)
    other = mounted(tmp_path / "b.h5", {"E": 5e7, "viscoelastic": PRONY})
    same(dynamic_stiffness(body, ranks, {"E_rubber": 5e7}), dynamic_stiffness(other, ranks))
    lossy = {"E": 4e7, "loss_factor": 0.1, "parameter": {"loss_factor": [0.0, 0.4]}}
    body = mounted(tmp_path / "c.h5", lossy)
    for loss in (0.0, 0.1, 0.4):
        other = mounted(tmp_path / "d.h5", {"E": 4e7, "loss_factor": loss})
        same(
            dynamic_stiffness(body, ranks, {"loss_factor_rubber": loss}),
            dynamic_stiffness(other, ranks),
        )


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_region_whose_stiffness_varies(ranks: int, tmp_path: Path) -> None:
    """Beside another of the same material."""
    plain = {"E": 4e7, "viscoelastic": PRONY}
    body = mounted(
        tmp_path / "a.h5",
        plain,
        regions={
            "mount": {"material": "steel", "parameter": {"stiffness": [0.8, 1.2]}},
            "part": {"material": "steel"},
        },
    )
    other = mounted(tmp_path / "b.h5", {"E": 1.1 * 210e9, "nu": 0.3, "rho": 7850.0}, nu=False)
    same(dynamic_stiffness(body, ranks, {"stiffness_mount": 1.1}), dynamic_stiffness(other, ranks))


MOUNT = {
    "at": "foot",
    "stiffness": [2e6, 3e6, 4e6, 5e3, 6e3, 7e3],
    "damping": [20.0, 30.0, 40.0, 0.5, 0.6, 0.7],
}
TIP = {"at": "tip", "stiffness": [1e5] * 6, "damping": [3.0] * 6, "loss_factor": 0.03}


def sprung(path: Path, **mount: Any) -> Path:
    beam(path, springs={"mount": MOUNT | mount, "tip": TIP}, damping={"alpha": 3.0, "beta": 1e-6})
    return path


@pytest.mark.parametrize("ranks", [1, 2])
def test_springs_and_dampers_between_two_numbers(ranks: int, tmp_path: Path) -> None:
    """A mount that relaxes, of a stiffness and a damping between two numbers; one whose loss factor
    and damping are."""
    body = sprung(
        tmp_path / "a.h5",
        viscoelastic=PRONY,
        loss_factor=0.1,
        parameter={"stiffness": [0.5, 2.0], "damping": [0.25, 4.0]},
    )
    for k, c in ((0.5, 4.0), (1.5, 0.3)):
        one = {
            "stiffness": list(k * np.array(MOUNT["stiffness"])),
            "damping": list(c * np.array(MOUNT["damping"])),
        }
        other = sprung(tmp_path / "b.h5", viscoelastic=PRONY, loss_factor=0.1, **one)
        values = {"stiffness_mount": k, "damping_mount": c}
        same(dynamic_stiffness(body, ranks, values), dynamic_stiffness(other, ranks))
    both = {"loss_factor": [0.05, 0.2], "damping": [1.0, 2.0]}
    body = sprung(tmp_path / "c.h5", loss_factor=0.1, parameter=both)
    other = sprung(
        tmp_path / "d.h5", loss_factor=0.15, damping=list(2 * np.array(MOUNT["damping"]))
    )
    values = {"loss_factor_mount": 0.15, "damping_mount": 2.0}
    same(dynamic_stiffness(body, ranks, values), dynamic_stiffness(other, ranks))


@pytest.mark.parametrize(
    ("rubber", "words"),
    [
        ({"E": 1e7, "parameter": {"E": [1e6, 2e7], "stiffness": [1, 2]}}, "E, or stiffness"),
        (
            {"E": 1e7, "loss_factor": 0.1, "parameter": {"E": [1e6, 2e7], "loss_factor": [0, 1]}},
            "cannot both vary",
        ),
        ({"E": 1e7, "parameter": {"loss_factor": [0, 1]}}, "loss_factor is missing"),
        (
            {"E": 1e7, "loss_factor": 2.0, "parameter": {"loss_factor": [0, 1]}},
            "must rise from zero or more, with the present one (2) between",
        ),
        ({"E": 1e7, "parameter": {"damping": [1, 2]}}, "unknown key damping"),
        ({"E": 1e7, "parameter": {}}, r"give E: [from, to]"),
    ],
)
def test_parameters_that_are_refused(rubber: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError) as refused:
        mounted(tmp_path / "a.h5", rubber)
    assert words in str(refused.value)


def test_parameters_of_regions_that_are_refused(tmp_path: Path) -> None:
    varies = {"parameter": {"stiffness": [0.5, 2]}}
    rubber = {"E": 1e7}
    for regions, words in (
        ({"mount": {"material": "rubber", **varies}}, "has a parameter itself"),
        ({"part": {"material": "steel", **varies}}, "a material has that name"),
    ):
        more = {"materials": {"steel": {"E": 1e9, "nu": 0.3, "rho": 1.0}}}
        more["materials"]["rubber"] = {**rubber, "nu": 0.4, "rho": 1.0, **varies}
        more["materials"]["part"] = more["materials"]["steel"]
        rest = {"mount": {"material": "rubber"}, "part": {"material": "steel"}}
        with pytest.raises(BodyError, match=words):
            mounted(tmp_path / "a.h5", rubber, regions=rest | regions, **more)


def test_a_damper_of_a_material_in_a_file(tmp_path: Path) -> None:
    body = mounted(tmp_path / "a.h5", {"E": 1e7})
    with h5py.File(body, "r+") as file:
        group = file["materials/rubber"].create_group("damper")
        group.attrs["law"] = "parameter*viscous"
        for name, value in {"least": 1.0, "most": 2.0, "value": 1.0, "slope": 1.0}.items():
            group.attrs[name] = value
    failed = run("reduce", "-body", body, "-mor_band_hz", "10,100", expect=1)
    assert "material rubber: damper is a part of springs" in message(failed)
