"""Viscoelastic materials of a mesh: YAML, assembly, beam theory, exports."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import flexgram
from bodies import box
from conftest import body_system, message, read_sparse, run
from flexgram import BodyError, ReducedModel
from flexgram.body.description import import_description
from flexgram.exporters import export
from flexgram.model.equivalent_damping import with_viscous_damping
from referee import System

TWO_PI = 2 * np.pi


def mounted(
    path: Path, rubber: dict[str, Any], kind: str = "hexahedron", nu: bool = True, **more: Any
) -> Path:
    """A steel box whose first third is rubber, held there; its nu is 0.4 unless it has none."""
    cells = (3, 1, 1) if kind == "tetra10" else (6, 2, 2)
    mesh = box(kind, cells, (0.3, 0.06, 0.05), distort=False)
    middle = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 0]
    soft = middle < 0.1
    mesh.cell_sets = {"mount": [np.flatnonzero(soft)], "part": [np.flatnonzero(~soft)]}
    content = {
        "materials": {
            "steel": {"E": 210e9, "nu": 0.3, "rho": 7850.0},
            "rubber": {**({"nu": 0.4} if nu else {}), "rho": 1100.0, **rubber},
        },
        "regions": {"mount": {"material": "rubber"}, "part": {"material": "steel"}},
        "interfaces": {"end": {"coupling": "distributing", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
        "damping": {"alpha": 2.0},
        **more,
    }
    import_description(content, "mounted", path, mesh=mesh)
    return path


def model_of(path: Path, rubber: dict[str, Any], **more: Any) -> ReducedModel:
    rom = flexgram.reduce(mounted(path, rubber, **more), (5, 1500), 1e-5)
    assert rom.met and rom.kind == "certified"
    return rom


def same(one: ReducedModel, other: ReducedModel, at: Any = (5.0, 140.0, 640.0, 1500.0)) -> bool:
    for hertz in at:
        H, second = (rom.transfer(TWO_PI * hertz) for rom in (one, other))
        if not np.linalg.norm(H - second) <= 3e-5 * np.linalg.norm(H):
            return False
    return True


def test_materials_of_a_description(tmp_path: Path) -> None:
    """Ways to say the same material: shares of long-term and of instantaneous moduli, all moduli
    at once or shear and bulk alike, a table; and limits that are bodies without terms."""
    series = [[0.2, 1e-3], [0.3, 1e-4]]
    prony = lambda E, **more: {"E": E, "viscoelastic": {"prony": series, **more}}  # noqa: E731
    rom = model_of(tmp_path / "a.h5", prony(5e7))
    assert same(rom, model_of(tmp_path / "b.h5", prony(10e7, moduli="instantaneous")))
    both = {"E": 5e7, "viscoelastic": {"prony": {"shear": series, "bulk": series}}}
    tets = {"kind": "tetra10"}
    whole = model_of(tmp_path / "c.h5", prony(5e7), **tets)
    assert same(whole, model_of(tmp_path / "d.h5", both, **tets))
    alone = {"E": 5e7, "viscoelastic": {"prony": {"shear": series}}}
    assert not same(whole, model_of(tmp_path / "e.h5", alone, **tets))
    # A table of the series at many frequencies is the series, nearly: linear between them.
    law = flexgram.prony(np.array([0.2, 0.3]) / 0.5, [1e-3, 1e-4])
    hz = np.linspace(4, 1501, 400)
    modulus = 5e7 * (1 + law.at(TWO_PI * hz))
    columns = {"hz": list(hz), "storage": list(modulus.real), "loss": list(modulus.imag)}
    table = model_of(tmp_path / "f.h5", {"viscoelastic": {"table": columns}})
    assert not table.system.poles().size == 0 and table.system.timeless
    for hertz in (hz[0] + 1, hz[200], 1499.0):
        H, second = (m.transfer(TWO_PI * hertz) for m in (rom, table))
        assert np.linalg.norm(H - second) < 1e-3 * np.linalg.norm(H)
    # Constant storage without loss is another E; slow relaxation is the instantaneous one.
    still = {"hz": [0, 2000], "storage": [8e7, 8e7], "loss_factor": [0, 0]}
    elastic = model_of(tmp_path / "g.h5", {"E": 8e7})
    assert same(elastic, model_of(tmp_path / "h.h5", {"viscoelastic": {"table": still}}))
    slow = {"E": 4e7, "viscoelastic": {"prony": [[0.5, 1e9]]}}
    assert same(elastic, model_of(tmp_path / "i.h5", slow))
    stress = {"outputs": {"root": {"type": "stress", "nodes": "start"}}}
    with pytest.warns(flexgram.ReductionWarning, match="stress in rubber is that of the long-term"):
        mounted(tmp_path / "j.h5", prony(5e7), **stress)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["materials/rubber/whole"].attrs["law"] == "prony"
    said = run("info", tmp_path / "a.h5").out
    assert "2 Prony terms" in said


@pytest.mark.parametrize("ranks", [1, 2])
def test_the_term_is_what_the_material_adds(ranks: int, tmp_path: Path) -> None:
    """T of the assembly is K with twice the rubber's E less K, and holds no more than its law."""
    prony = {"viscoelastic": {"prony": [[0.2, 1e-3]]}}
    assembled = tmp_path / "T.h5"
    body = mounted(tmp_path / "a.h5", {"E": 5e7, "loss_factor": 0.1, **prony})
    run("assemble", "-body", body, "-body_out", assembled, ranks=ranks)
    one, two = (body_system(mounted(tmp_path / f"{E:g}.h5", {"E": E})) for E in (5e7, 1e8))
    with h5py.File(assembled) as file:
        T = read_sparse(file, "terms/rubber")
        S = read_sparse(file, "S")
        assert file["terms/rubber"].attrs["law"] == "prony"
        assert file["terms/rubber"].attrs["g"] == pytest.approx(0.25)
    K_rubber = two.K - one.K
    assert abs(T - K_rubber).max() < 1e-12 * abs(two.K).max()
    assert abs(S - 0.1 * K_rubber).max() < 1e-12 * abs(two.K).max()


def test_tables_of_shear_and_bulk(tmp_path: Path) -> None:
    """A table of the shear modulus with a bulk modulus that does not change is the series of shear
    alone, nearly: linear between its rows. Tables of both with one loss factor are one of all."""
    series, tets = [[0.2, 1e-3], [0.3, 1e-4]], {"kind": "tetra10"}
    alone = {"E": 5e7, "viscoelastic": {"prony": {"shear": series}}}
    rom = model_of(tmp_path / "a.h5", alone, **tets)
    law = flexgram.prony(np.array([0.2, 0.3]) / 0.5, [1e-3, 1e-4])
    hz = np.linspace(4, 1501, 400)
    shear, bulk = 5e7 / 2.8, 5e7 / 0.6
    modulus = shear * (1 + law.at(TWO_PI * hz))
    columns = {"hz": list(hz), "storage": list(modulus.real), "loss": list(modulus.imag)}
    tables = {"viscoelastic": {"table": {"shear": columns, "bulk": bulk}}}
    other = model_of(tmp_path / "b.h5", tables, nu=False, **tets)
    for hertz in (hz[0] + 1, hz[200], 1499.0):
        H, second = (m.transfer(TWO_PI * hertz) for m in (rom, other))
        assert 0 < np.linalg.norm(H - second) < 1e-3 * np.linalg.norm(H)
    both = {
        part: {"hz": [0, 2000], "storage": [x, 2 * x], "loss_factor": [0.1, 0.2]}
        for part, x in (("shear", shear), ("bulk", bulk))
    }
    whole = {"hz": [0, 2000], "storage": [5e7, 1e8], "loss_factor": [0.1, 0.2]}
    assert same(
        model_of(tmp_path / "c.h5", {"viscoelastic": {"table": both}}, nu=False, **tets),
        model_of(tmp_path / "d.h5", {"viscoelastic": {"table": whole}}, **tets),
    )


def test_mixed_relaxation_of_shear_and_bulk_by_another_assembly(tmp_path: Path) -> None:
    """At a frequency the body is the elastic one with complex moduli: of small parts of it, as
    the derivative of K by G and by the bulk modulus."""
    shear, bulk = [[0.4, 2e-4]], [[0.1, 1e-3]]
    rubber = {"E": 6e7, "viscoelastic": {"prony": {"shear": shear, "bulk": bulk}}}
    rom = model_of(tmp_path / "a.h5", rubber, kind="tetra10")
    G, k = 6e7 / 2.8, 6e7 / 0.6

    def matrices(G: float, k: float, name: str) -> System:
        E, nu = 9 * k * G / (3 * k + G), (3 * k - 2 * G) / (2 * (3 * k + G))
        path = tmp_path / f"{name}.h5"
        return body_system(mounted(path, {"E": E, "nu": nu}, kind="tetra10"))

    here, stiff, dense = matrices(G, k, "x"), matrices(2 * G, k, "y"), matrices(G, 2 * k, "z")
    K, M = here.K.toarray(), here.M.toarray()
    K_G, K_k = stiff.K.toarray() - K, dense.K.toarray() - K
    for hertz in (5.0, 200.0, 900.0, 1500.0):
        s = 1j * TWO_PI * hertz
        g_G, g_k = (g / (1 - g) * s * tau / (1 + s * tau) for [[g, tau]] in (shear, bulk))
        A = K + g_G * K_G + g_k * K_k + (s * s + 2.0 * s) * M
        H = here.B.T @ np.linalg.solve(A, here.B)
        assert np.linalg.norm(rom.transfer(TWO_PI * hertz) - H) <= 1e-5 * np.linalg.norm(H)


def test_free_layer_damping_against_beam_theory(tmp_path: Path) -> None:
    """Oberst's beam, a steel strip with a damping layer whose modulus is a table: resonances and
    loss factors of H at the tip are those of a cantilever with the layers' complex bending
    stiffness (Oberst 1952), E and eta at each frequency. Poisson's ratio is zero, as in a beam."""
    length, width, h1, h2, E1, rho1, rho2 = 0.2, 0.01, 0.002, 0.003, 210e9, 7850.0, 1500.0
    hz = [0.0, 40.0, 200.0, 500.0, 1200.0]
    storage, eta = [1.5e9, 2.0e9, 3.0e9, 4.0e9, 5.0e9], [0.1, 0.3, 0.5, 0.4, 0.3]
    mesh = box("hexahedron20", (40, 1, 5), (length, width, h1 + h2), distort=False)
    middle = mesh.points[mesh.cells[0].data].mean(axis=1)[:, 2]
    low = middle - mesh.points[:, 2].min() < h1
    mesh.cell_sets = {"strip": [np.flatnonzero(low)], "layer": [np.flatnonzero(~low)]}
    table = {"hz": hz, "storage": storage, "loss_factor": eta}
    content = {
        "materials": {
            "steel": {"E": E1, "nu": 0.0, "rho": rho1},
            "polymer": {"nu": 0.0, "rho": rho2, "viscoelastic": {"table": table}},
        },
        "regions": {"strip": {"material": "steel"}, "layer": {"material": "polymer"}},
        "interfaces": {"tip": {"coupling": "rigid", "nodes": "end"}},
        "supports": {"start": {"nodes": "start"}},
    }
    import_description(content, "Oberst", tmp_path / "a.h5", mesh=mesh)
    rom = flexgram.reduce(tmp_path / "a.h5", (5, 1200), 1e-3, inputs=["tip.fz"])
    assert rom.met and rom.kind == "certified"

    def stiffness(f: Any) -> Any:
        E2 = np.interp(f, hz, storage) + 1j * np.interp(f, hz, np.array(storage) * np.array(eta))
        axis = (E1 * h1 * h1 / 2 + E2 * h2 * (h1 + h2 / 2)) / (E1 * h1 + E2 * h2)
        strip, layer = h1**3 / 12 + h1 * (axis - h1 / 2) ** 2, h2**3 / 12
        return width * (E1 * strip + E2 * (layer + h2 * (h1 + h2 / 2 - axis) ** 2))

    def tip(f: Any) -> Any:
        EI, w = stiffness(f), TWO_PI * f
        b = (w * w * width * (rho1 * h1 + rho2 * h2) / EI) ** 0.25
        x = b * length
        top = np.sin(x) * np.cosh(x) - np.cos(x) * np.sinh(x)
        return top / (EI * b**3 * (1 + np.cos(x) * np.cosh(x)))

    def peaks(f: Any, H: Any) -> list[tuple[float, float]]:
        """Where |ω H| is largest, and the width at half of its power over that."""
        size, found = np.abs(f * H), []
        for k in np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])) + 1:
            above = size > size[k] / np.sqrt(2)
            first, last = k, k
            while above[first - 1]:
                first -= 1
            while above[last + 1]:
                last += 1
            found.append((f[k], (f[last] - f[first]) / f[k]))
        return found

    f = np.arange(5.0, 1200.0, 0.02)
    z = rom.outputs.index("tip.fz")
    ours, theirs = peaks(f, rom.transfer(TWO_PI * f)[:, z, 0]), peaks(f, tip(f))
    assert len(ours) == len(theirs) >= 3
    for (at, loss), (other, other_loss) in zip(ours, theirs, strict=True):
        assert at == pytest.approx(other, rel=0.01)
        assert loss == pytest.approx(other_loss, rel=0.05)


def test_exports_say_what_they_cannot_hold(tmp_path: Path) -> None:
    """Formats of K, M and D refuse terms; an equivalent damping tells what it changes."""
    rom = model_of(tmp_path / "a.h5", {"E": 5e7, "viscoelastic": {"prony": [[0.3, 3e-4]]}})
    for kind in ("abaqus", "nastran", "dmig", "mbdyn"):
        with pytest.raises(BodyError, match=r"rubber, viscoelastic: 1 Prony term.*--damping modal"):
            export(rom, tmp_path / f"b.{kind}", kind)
    viscous, error = with_viscous_damping(rom)
    assert not viscous.system.loss and 0 < error < 0.5
    _, other = with_viscous_damping(rom, "rayleigh")
    assert other > error
    shapes = np.linalg.eigvalsh(np.linalg.solve(viscous.M, viscous.K))
    assert np.sqrt(shapes.min()) > rom.modes.min()  # stiffer than in the long term
    form = rom.physical()
    for omega in (300.0, 2000.0, 9000.0):
        H, turned = rom.transfer(omega), form.transfer(omega)
        assert np.linalg.norm(turned - H) < 1e-8 * np.linalg.norm(H)


def test_relaxation_stays_where_a_loss_factor_is_replaced(tmp_path: Path) -> None:
    """Of a body with both: state spaces keep the internal states of Prony terms, and H is nearer to
    that of the body than with all of it replaced."""
    steel = {"E": 210e9, "nu": 0.3, "rho": 7850.0, "loss_factor": 0.02}
    rubber = {"E": 5e7, "nu": 0.4, "rho": 1100.0, "viscoelastic": {"prony": [[0.3, 3e-4]]}}
    both = {"materials": {"steel": steel, "rubber": rubber}}
    rom = model_of(tmp_path / "a.h5", {}, **both)
    assert rom.system.S.any() and rom.system.terms
    kept, error = with_viscous_damping(rom, keep_relaxation=True)
    _, without = with_viscous_damping(rom)
    assert error < 0.5 * without and kept.system.terms == rom.system.terms
    rom.save(tmp_path / "rom.h5")
    said = run(
        *("export", tmp_path / "rom.h5", "--to", "state-space", "--damping", "modal"),
        *("-o", tmp_path / "a.npz"),
    ).out
    assert "state-space keeps rubber, viscoelastic: 1 Prony term" in said
    with np.load(tmp_path / "a.npz") as file:
        A, B, C, D = (file[name] for name in "ABCD")
    states = len(A) - 2 * rom.order
    assert states > 0
    assert f"Prony terms have {states} internal states, beside the {2 * rom.order} of" in said
    for hertz in (20.0, 300.0, 1400.0):
        H = C @ np.linalg.solve(2j * np.pi * hertz * np.eye(len(A)) - A, B) + D
        assert np.linalg.norm(H - rom.transfer(TWO_PI * hertz)) <= error * np.linalg.norm(H) * 1.1
    none = model_of(tmp_path / "b.h5", {"E": 5e7, "viscoelastic": {"prony": [[0.3, 3e-4]]}})
    with pytest.raises(BodyError, match="has no loss factor that it could replace"):
        with_viscous_damping(none, keep_relaxation=True)


@pytest.mark.parametrize(
    ("rubber", "said"),
    [
        ({"E": 1e7, "viscoelastic": {}}, "give prony, or table"),
        ({"E": 1e7, "viscoelastic": 5}, "viscoelastic must be a mapping"),
        ({"E": 1e7, "viscoelastic": {"prony": ["12"]}}, "must be a list of numbers"),
        ({"E": 1e7, "viscoelastic": {"prony": [[0.6, 1], [0.5, 2]]}}, "sum below 1"),
        ({"E": 1e7, "viscoelastic": {"prony": [[-0.1, 1]]}}, "not negative"),
        ({"E": 1e7, "viscoelastic": {"prony": [[0.1, 0]]}}, "tau [s] is positive"),
        ({"E": 1e7, "viscoelastic": {"prony": [0.1, 1]}}, "must be a list"),
        ({"E": 1e7, "viscoelastic": {"prony": [[0.1, 1]], "modulus": "x"}}, "unknown key modulus"),
        ({"E": 1e7, "viscoelastic": {"prony": {"axial": [[0.1, 1]]}}}, "unknown key axial"),
        ({"E": 1e7, "viscoelastic": {"table": {"hz": [1, 2]}}}, "leave E out"),
        ({"viscoelastic": {"table": {"hz": [1, 2], "storage": [1e7, 2e7]}}}, "loss or loss_factor"),
        ({"viscoelastic": {"table": {"shear": 1e7, "bulk": 1e8}}}, "leave it out"),
        ({"viscoelastic": {"table": {"shear": {"hz": [1]}, "bulk": 1e8, "E": 1}}}, "unknown key E"),
        (
            {"viscoelastic": {"table": {"hz": [2, 1], "storage": [1e7, 2e7], "loss": [0, 0]}}},
            "hz must rise",
        ),
        (
            {"viscoelastic": {"table": {"hz": [1, 2], "storage": [1e7], "loss": [0, 0]}}},
            "have 2, 1 and 2 numbers",
        ),
    ],
)
def test_descriptions_that_are_refused(rubber: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(BodyError, match="materials: rubber") as refused:
        mounted(tmp_path / "a.h5", rubber)
    assert said in str(refused.value)


def test_elements_that_mix_shear_and_bulk_are_refused(tmp_path: Path) -> None:
    shear = {"E": 5e7, "viscoelastic": {"prony": {"shear": [[0.3, 3e-4]]}}}
    failed = run(
        *("reduce", "-body", mounted(tmp_path / "b.h5", shear), "-mor_band_hz", "10,100"), expect=1
    )
    assert "needs tetrahedra, hexahedra of 20 nodes or wedges, not hexahedron" in message(failed)


@pytest.mark.parametrize("given", [{"table": {"hz": [1]}}, {"prony": {"shear": [[0.1, 1]]}}])
def test_orthotropic_materials_relax_alike(given: dict[str, Any], tmp_path: Path) -> None:
    """All moduli by one list; other ways are refused."""
    moduli = dict.fromkeys(("E1", "E2", "E3"), 1e9) | dict.fromkeys(("nu12", "nu13", "nu23"), 0.2)
    wood = {**moduli, **dict.fromkeys(("G12", "G13", "G23"), 4e8), "rho": 600.0}
    series = {"moduli": "instantaneous", "prony": [[0.2, 1e-3]]}
    body = mounted(tmp_path / "a.h5", {"viscoelastic": series, **wood}, nu=False)
    with h5py.File(body) as file:
        material = file["materials/rubber"]
        assert material.attrs["engineering_constants"][0] == pytest.approx(0.8e9)
        assert material["whole"].attrs["g"] == pytest.approx(0.25)
    with pytest.raises(BodyError, match="are for isotropic materials"):
        mounted(tmp_path / "b.h5", {"viscoelastic": given, **wood}, nu=False)
