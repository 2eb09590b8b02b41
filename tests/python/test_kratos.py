"""Shells of Kratos Multiphysics, where it is installed: matrices, places, interfaces, claims."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse.linalg as spl
from test_importers import frequencies
from test_shells import Sheet

from conftest import assert_certified, certified
from flexgram import BodyError
from flexgram.importers import import_matrices, parse
from flexgram.importers.kratos import matrices
from sheets import flat, sheet

kratos = pytest.importorskip("KratosMultiphysics")
application = pytest.importorskip("KratosMultiphysics.StructuralMechanicsApplication")

LENGTH, WIDTH, THICKNESS = 1.0, 0.6, 0.005
E, NU, RHO = 210e9, 0.3, 7850.0
COUNTS = (16, 10)


@pytest.fixture
def plate() -> Any:
    """A free plate of thick shells; its ends are sub model parts."""
    model = kratos.Model()
    part = model.CreateModelPart("plate", 2)
    part.ProcessInfo[kratos.DOMAIN_SIZE] = 3
    part.ProcessInfo[application.RAYLEIGH_ALPHA] = 2.0
    for variable in (
        kratos.DISPLACEMENT,
        kratos.ROTATION,
        kratos.REACTION,
        kratos.REACTION_MOMENT,
        kratos.VOLUME_ACCELERATION,
    ):
        part.AddNodalSolutionStepVariable(variable)
    steel = part.CreateNewProperties(1)
    for variable, value in (
        (kratos.YOUNG_MODULUS, E),
        (kratos.POISSON_RATIO, NU),
        (kratos.DENSITY, RHO),
        (kratos.THICKNESS, THICKNESS),
    ):
        steel[variable] = value
    steel[kratos.CONSTITUTIVE_LAW] = application.ReissnerMindlinShellElasticConstitutiveLaw()
    across, along = COUNTS[0] + 1, COUNTS[1] + 1
    for number in range(across * along):
        i, j = number % across, number // across
        part.CreateNewNode(number + 1, LENGTH * i / COUNTS[0], WIDTH * j / COUNTS[1], 0.0)
    for number in range(COUNTS[0] * COUNTS[1]):
        first = 1 + number % COUNTS[0] + across * (number // COUNTS[0])
        nodes = [first, first + 1, first + across + 1, first + across]
        part.CreateNewElement("ShellThickElement3D4N", number + 1, nodes, steel)
    for kind, reaction in (("DISPLACEMENT", "REACTION"), ("ROTATION", "REACTION_MOMENT")):
        for axis in "XYZ":
            kratos.VariableUtils().AddDof(
                getattr(kratos, f"{kind}_{axis}"), getattr(kratos, f"{reaction}_{axis}"), part
            )
    for name, x in (("left", 0.0), ("right", LENGTH)):
        end = part.CreateSubModelPart(name)
        end.AddNodes([node.Id for node in part.Nodes if abs(node.X0 - x) < 1e-9])
    return model, part


def test_a_plate_is_a_plate(plate: Any) -> None:
    """Six rigid motions, its mass, and simply supported Kirchhoff's frequencies."""
    _, part = plate
    free = matrices(part)
    mass = RHO * LENGTH * WIDTH * THICKNESS
    u = (free.component == 2).astype(float)
    assert u @ free.M @ u == pytest.approx(mass, rel=1e-12)
    assert free.alpha == 2.0 and free.thin and free.blocks[0][0] == "quad"
    assert frequencies(free.K, free.M)[6] > 10 and np.all(frequencies(free.K, free.M)[:6] < 1e-2)
    for node in part.Nodes:
        if node.X0 in (0.0, LENGTH) or abs(node.Y0 % WIDTH) < 1e-9 or node.Y0 >= WIDTH - 1e-9:
            for axis in "XYZ":
                node.Fix(getattr(kratos, f"DISPLACEMENT_{axis}"))
    held = matrices(part)
    assert held.K.shape[0] == free.K.shape[0] - 3 * 2 * sum(COUNTS)
    stiffness = E * THICKNESS**3 / 12 / (1 - NU**2)
    exact = sorted(
        np.pi / 2 * np.sqrt(stiffness / RHO / THICKNESS) * ((m / LENGTH) ** 2 + (n / WIDTH) ** 2)
        for m in range(1, 6)
        for n in range(1, 6)
    )
    assert np.allclose(frequencies(held.K, held.M)[:2], exact[:2], rtol=0.01)


@pytest.mark.parametrize("coupling", ["rigid", "distributing"])
def test_from_shells_to_a_claim(plate: Any, coupling: str, tmp_path: Path) -> None:
    _, part = plate
    body = tmp_path / "plate.h5"
    facts = import_matrices(
        matrices(part), body, [parse(coupling, f"{end}=NSET:{end}") for end in ("left", "right")]
    )
    assert facts["free"] == 6
    assert facts["mass"] == pytest.approx(RHO * LENGTH * WIDTH * THICKNESS, rel=1e-9)
    result = certified(body, (5.0, 150.0), tmp_path, "-mor_tol", "1e-4")
    assert_certified(result, 1e-4)


def test_what_is_not_in_the_matrices(plate: Any) -> None:
    model, part = plate
    part.CreateNewMasterSlaveConstraint(
        "LinearMasterSlaveConstraint",
        1,
        part.Nodes[1],
        kratos.DISPLACEMENT_X,
        part.Nodes[2],
        kratos.DISPLACEMENT_X,
        1.0,
        0.0,
    )
    with pytest.raises(BodyError, match="multi-point constraints are not in Kratos' matrices"):
        matrices(part)
    with pytest.raises(BodyError, match="no displacement"):
        matrices(model.CreateModelPart("empty"))


@pytest.mark.parametrize("shape", ["flat", "roof"])
def test_our_shells_beside_theirs(shape: str, tmp_path: Path) -> None:
    """A clamped plate and a clamped curved panel of the same quadrilaterals, both MITC4: six
    frequencies differ by 1.5 % with ten elements a side, by 0.5 % with twenty."""
    of = {
        "flat": flat(1.0, 0.6),
        "roof": lambda u, v: (
            0.5 * np.sin(1.2 * (u - 0.5)),
            0.8 * v,
            0.5 * np.cos(1.2 * (u - 0.5)),
        ),
    }[shape]
    apart = []
    for count in (10, 20):
        mesh = sheet("quad", (count, count), of)
        model = kratos.Model()
        theirs = theirs_of(model, mesh, 0.02)
        squares = spl.eigsh(
            theirs.K.tocsc(), 6, theirs.M.tocsc(), sigma=0, return_eigenvectors=False
        )
        ours = Sheet(tmp_path, mesh, {"thickness": 0.02}, {"E": E, "nu": NU, "rho": RHO})
        held = ours.rows("start", range(6))
        apart.append(
            np.abs(np.sqrt(np.sort(squares)) / (2 * np.pi) / ours.hertz(6, held) - 1).max()
        )
    assert apart[0] < 0.015 and apart[1] < 0.005


def theirs_of(model: Any, mesh: Any, thickness: float) -> Any:
    """K and M of Kratos' thick shells of a mesh that is clamped at its start."""
    part = model.CreateModelPart("sheet", 2)
    part.ProcessInfo[kratos.DOMAIN_SIZE] = 3
    for name in ("DISPLACEMENT", "ROTATION", "REACTION", "REACTION_MOMENT", "VOLUME_ACCELERATION"):
        part.AddNodalSolutionStepVariable(getattr(kratos, name))
    steel = part.CreateNewProperties(1)
    for name, value in (
        ("YOUNG_MODULUS", E), ("POISSON_RATIO", NU), ("DENSITY", RHO), ("THICKNESS", thickness)
    ):  # fmt: skip
        steel[getattr(kratos, name)] = value
    steel[kratos.CONSTITUTIVE_LAW] = application.ReissnerMindlinShellElasticConstitutiveLaw()
    for number, place in enumerate(mesh.points, 1):
        part.CreateNewNode(number, *map(float, place))
    for number, cell in enumerate(mesh.cells[0].data, 1):
        part.CreateNewElement("ShellThickElement3D4N", number, [int(n) + 1 for n in cell], steel)
    names = [f"{kind}_{axis}" for kind in ("DISPLACEMENT", "ROTATION") for axis in "XYZ"]
    for name in names:
        reaction = name.replace("DISPLACEMENT", "REACTION").replace("ROTATION", "REACTION_MOMENT")
        kratos.VariableUtils().AddDof(getattr(kratos, name), getattr(kratos, reaction), part)
        for node in mesh.point_sets["start"].tolist():
            part.Nodes[node + 1].Fix(getattr(kratos, name))
    return matrices(part)
