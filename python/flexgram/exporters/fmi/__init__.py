"""A functional mock-up unit (FMI 2.0 or 3.0) of a reduced body: source and binary."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexgram.basics import BodyError, written_aside
from flexgram.exporters.fmi.description import Description
from flexgram.exporters.fmi.matrices import StateSpace
from flexgram.model.reduced import ReducedBody
from flexgram.model.system import RATES

VERSIONS = (2, 3)
SOURCE = Path(__file__).parent / "model.c"
#: Platforms by FMI 2.0 and 3.0.
PLATFORMS = {"x86_64": ("linux64", "x86_64-linux"), "aarch64": ("aarch64-linux", "aarch64-linux")}


def _header(space: StateSpace, version: int, token: str) -> str:
    """What model.c includes: the numbers."""
    arrays = {"A0": space.A0, "A1": space.A1, "B": space.B}
    arrays |= {"C0": space.C0, "C1": space.C1, "D": space.D}
    for k, name in enumerate(("GAIN_A0", "GAIN_A1", "GAIN_C0", "GAIN_C1")):
        arrays[name] = np.vstack([parts[k] for *_, parts in space.gains] or [np.zeros((1, 1))])
    laws = list(space.parameters.values())
    for name, field in {"PRESENT": "value", "LEAST": "least", "MOST": "most"}.items():
        arrays[name] = np.array([[getattr(law, field) for law in laws] or [0.0]])
    whole = {
        "GAIN_OF": [number for number, *_ in space.gains] or [0],
        "GAIN_POWER": [power for _, power, _ in space.gains] or [1],
    }
    sizes = {"NX": len(space.A0), "NU": space.B.shape[1], "NY": len(space.C0)}
    sizes |= {"NP": len(laws), "NG": len(space.gains)}
    lines = [f"#define FMI {version}", f'#define TOKEN "{token}"']
    lines += [f"#define {name} {value}" for name, value in sizes.items()]
    for name, a in arrays.items():
        numbers = ",\n".join(", ".join(float(x).hex() for x in row) for row in a)
        lines.append(f"static const double {name}[{a.size}] = {{\n{numbers}}};")
    for name, integers in whole.items():
        lines.append(
            f"static const int {name}[{len(integers)}] = {{{', '.join(map(str, integers))}}};"
        )
    return "\n".join(lines) + "\n"


def _compile(folder: Path, library: Path) -> None:
    compiler = next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), None)
    if compiler is None:
        raise BodyError(
            "no C compiler for the binary of the FMU: install one (Debian: apt install gcc)"
        )
    command = [
        compiler,
        "-std=c11",
        "-O2",
        "-shared",
        "-fPIC",
        "-fvisibility=hidden",
        "-o",
        str(library),
        str(folder / "model.c"),
        "-lm",
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise BodyError(f"{' '.join(command)} failed: {done.stderr.strip()[:300]}")


def write_fmu(
    model: ReducedBody, path: Path, version: int = 2, rates: Sequence[str] | None = None
) -> None:
    """Write an FMU: co-simulation by exact steps and model exchange, source and the binary of this
    platform.

    Inputs are the ports; outputs ``port.motion``, ``.velocity``, ``.acceleration``; the parameter
    ``damping_factor`` multiplies the damping, and parameters of the body are parameters, from their
    least to their most, with their present values at the start. A held or guided body; of a free
    one small motions.

    Parameters
    ----------
    model : ReducedBody
    path : Path
    version : int
        Of FMI: 2 or 3.
    rates : sequence of str, optional
        What is an output, of ``displacement``, ``velocity``, ``acceleration``; default: all, of a
        body with a feedthrough displacements alone.

    Raises
    ------
    BodyError
        With structural damping, or without a C compiler; for rates of a feedthrough.

    Examples
    --------
    >>> write_fmu(flexgram.ReducedModel.load("standing.rom.h5"), Path("standing.fmu"), version=3)
    """
    if version not in VERSIONS:
        raise BodyError(f"FMI {version} must be one of {', '.join(map(str, VERSIONS))}")
    rates = rates or (RATES[:1] if model.system.feedthrough.any() else RATES)
    most = {name: law.most for name, law in model.system.parameters.items()}
    for values in (None, most):
        model.system.at(values).expect_time_domain(rates)
    machine = platform.machine()
    if machine not in PLATFORMS or platform.system() != "Linux":
        raise BodyError(
            f"an FMU's binary is made for {', '.join(PLATFORMS)} on Linux, not {machine}"
        )
    name = re.sub(r"\W", "_", path.stem)
    name = name if re.match("[A-Za-z_]", name) else f"_{name}"
    token = f"{{{uuid.uuid4()}}}"
    space = StateSpace.of(model, rates)
    description = Description(model, rates, len(space.A0), name, token)
    with tempfile.TemporaryDirectory(prefix="flexgram-fmu-") as work:
        folder = Path(work)
        shutil.copyfile(SOURCE, folder / "model.c")
        (folder / "model_data.h").write_text(_header(space, version, token))
        library = folder / f"{name}.so"
        _compile(folder, library)
        xml = description.of_version_2() if version == 2 else description.of_version_3()
        build = (
            '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">\n'
            f'  <BuildConfiguration modelIdentifier="{name}">\n    <SourceFileSet '
            'language="C11"><SourceFile name="model.c"/></SourceFileSet>\n'
            "  </BuildConfiguration>\n</fmiBuildDescription>\n"
        )
        with (
            written_aside(path) as place,
            zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as archive,
        ):
            archive.writestr("modelDescription.xml", xml)
            for source in ("model.c", "model_data.h"):
                archive.write(folder / source, f"sources/{source}")
            if version == 3:
                archive.writestr("sources/buildDescription.xml", build)
            archive.write(library, f"binaries/{PLATFORMS[machine][version - 2]}/{name}.so")
