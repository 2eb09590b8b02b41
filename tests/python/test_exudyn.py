"""Reduced bodies at work in EXUDYN, a multibody code of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies import box, write_body_file
from conftest import assembled, run

from flexgram import ReducedModel

exu = pytest.importorskip("exudyn")
import exudyn.itemInterface as eii  # noqa: E402

from flexgram.exporters.exudyn import add_body  # noqa: E402

SIZE = (0.5, 0.02, 0.02)
PIVOT = [0.0, 0.01, 0.01]
GRAVITY = (0.0, -9.81, 0.0)
#: soft: the tip of the swinging beam bends by some per cent of its length
SOFT = {"E": 2e8, "nu": 0.3, "rho": 2000.0}


def swing(mbs: Any, start: int, sensor: Any, end_time: float = 0.6, steps: int = 600) -> Any:
    """Hang the body by a ball joint at the marker ``start`` and let it fall, over all of 115°."""
    ground = mbs.AddObject(eii.ObjectGround())
    pivot = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=ground, localPosition=PIVOT))
    mbs.AddObject(eii.SphericalJoint(markerNumbers=[pivot, start]))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.endTime = end_time
    settings.timeIntegration.newton.useModifiedNewton = False
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.8
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    mbs.SolveDynamic(settings)
    return mbs.GetSensorStoredData(sensor)


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("exudyn")
    body, rom = folder / "beam.h5", folder / "beam.rom.h5"
    mesh = box("tetra10", (8, 1, 1), SIZE, distort=False)
    ends = {name: {"coupling": "distributing", "set": name} for name in ("start", "end")}
    write_body_file(body, mesh, material=SOFT, interfaces=ends, damping=(0, 2e-3, 0))
    run("reduce", "-body", body, "-mor_band_hz", "0.5,200", "-mor_tol", "1e-4", "-mor_out", rom)
    return body, rom


def test_swinging_beam_against_exudyns_full_model(beam: tuple[Path, Path], tmp_path: Path) -> None:
    """Large rotation: the reduced body against EXUDYN's own floating frame with all nodes."""
    from exudyn.FEM import FEMinterface, ObjectFFRFinterface

    body, rom = beam
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    added = add_body(exu, mbs, ReducedModel.load(rom), gravity=GRAVITY)
    sensor = mbs.AddSensor(
        eii.SensorMarker(
            markerNumber=added["markers"]["end"],
            storeInternal=True,
            outputVariableType=exu.OutputVariableType.Position,
        )
    )
    ours = swing(mbs, added["markers"]["start"], sensor)

    full = assembled(tmp_path / "full.h5", body)
    order = np.lexsort((full["component"], full["node"]))
    fem = FEMinterface()
    points = full["position"][order][::3]
    fem.nodes = {"Position": points}
    fem.massMatrix, fem.stiffnessMatrix = (full[x][order][:, order].tocsr() for x in "MK")
    fem.modeBasis = {"matrix": np.zeros((len(order), 0)), "type": "none"}
    fem.surface, fem.postProcessingModes = [], {}
    interface = ObjectFFRFinterface(fem)
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    objects = interface.AddObjectFFRF(
        exu,
        mbs,
        gravity=list(GRAVITY),
        massProportionalDamping=1e-12,
        stiffnessProportionalDamping=2e-3,
    )
    mass = mbs.AddMarker(eii.MarkerBodyMass(bodyNumber=objects["oFFRF"]))
    mbs.AddLoad(eii.LoadMassProportional(markerNumber=mass, loadVector=list(GRAVITY)))
    marker = {}
    for name, x in (("start", 0.0), ("end", SIZE[0])):
        nodes = np.flatnonzero(points[:, 0] == x)
        marker[name] = mbs.AddMarker(
            eii.MarkerSuperElementPosition(
                bodyNumber=objects["oFFRF"],
                meshNodeNumbers=nodes.tolist(),
                weightingFactors=[1 / len(nodes)] * len(nodes),
            )
        )
    sensor = mbs.AddSensor(
        eii.SensorMarker(
            markerNumber=marker["end"],
            storeInternal=True,
            outputVariableType=exu.OutputVariableType.Position,
        )
    )
    theirs = swing(mbs, marker["start"], sensor)

    middle = np.array(PIVOT)
    angle = np.arctan2(*(theirs[:, 2:0:-1] - middle[1::-1]).T)
    assert np.ptp(angle) > 2  # more than 115 degrees
    reach = np.linalg.norm(theirs[:, 1:3] - middle[:2], axis=1)
    assert reach.min() < 0.995 * SIZE[0]  # it bends
    difference = np.linalg.norm(ours[:, 1:] - theirs[:, 1:], axis=1)
    assert difference.max() < 2e-3 * SIZE[0], difference.max()
