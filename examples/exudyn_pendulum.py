"""A flexible pendulum in EXUDYN: reduced body, floating frame, large rotation.

    .venv/bin/python3 examples/exudyn_pendulum.py [folder]

Needs exudyn (pip install exudyn). The rack swings about its lower plate under gravity.
"""

import sys
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np

import flexgram
from flexgram.exporters.exudyn import add_body
from flexgram.model.geometry import interface_positions

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)
flexgram.import_body("meshes/rack.yaml", out / "rack.h5")
rom = flexgram.reduce(out / "rack.h5", band_hz=(10, 300), tol=1e-2)
print(rom)

mbs = exu.SystemContainer().AddSystem()
body = add_body(exu, mbs, rom, gravity=(9.81, 0, 0))
ground = mbs.AddObject(eii.ObjectGround())
at = interface_positions(rom)["lower"].tolist()
wall = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=ground, localPosition=at))
hinge = [1, 1, 1, 1, 0, 1]  # free to turn about y
mbs.AddObject(
    eii.GenericJoint(markerNumbers=[wall, body["markers"]["lower"]], constrainedAxes=hinge)
)
sensor = mbs.AddSensor(
    eii.SensorMarker(
        markerNumber=body["markers"]["upper"],
        storeInternal=True,
        outputVariableType=exu.OutputVariableType.Position,
    )
)
mbs.Assemble()
settings = exu.SimulationSettings()
settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 0.8, 800
settings.timeIntegration.verboseMode = 0
settings.timeIntegration.newton.useModifiedNewton = True
settings.timeIntegration.generalizedAlpha.spectralRadius = 0.7
settings.solution.file.write = False
settings.solution.sensors.writePeriod = 0.01
mbs.SolveDynamic(settings)
data = mbs.GetSensorStoredData(sensor)
arm = data[:, 1:] - at
angle = np.degrees(np.unwrap(np.arctan2(arm[:, 0], arm[:, 2])))
print(f"the rack has turned by {np.ptp(angle):.1f} degrees after {data[-1, 0]:.2f} s")
