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
from xml.sax.saxutils import quoteattr

import numpy as np
import scipy.linalg

from flexgram.basics import BodyError, Floats, written_aside
from flexgram.body.terms import Term
from flexgram.body.varying_laws import Parameter
from flexgram.model.internal_states import InternalStates
from flexgram.model.kinds import unit_of
from flexgram.model.physical import facts_of
from flexgram.model.reduced import ReducedBody
from flexgram.model.system import RATES, System

VERSIONS = (2, 3)
SOURCE = Path(__file__).parent / "model.c"
#: Platforms by FMI 2.0 and 3.0.
PLATFORMS = {"x86_64": ("linux64", "x86_64-linux"), "aarch64": ("aarch64-linux", "aarch64-linux")}
#: Base units of the units of ports, as FMI names them.
BASE = {
    "N": "kg='1' m='1' s='-2'",
    "N.m": "kg='1' m='2' s='-2'",
    "m": "m='1'",
    "rad": "rad='1'",
    "m/s2": "m='1' s='-2'",
    "rad/s2": "rad='1' s='-2'",
    "Pa": "kg='1' m='-1' s='-2'",
    "K": "K='1'",
    "m/s": "m='1' s='-1'",
    "rad/s": "rad='1' s='-1'",
}


def _matrices(model: ReducedBody, rates: Sequence[str]) -> dict[str, Floats]:
    """The state space with coordinates that are as large as their velocities, each times its own
    frequency; what damping adds to A and C by itself; and of each parameter of the body what a unit
    of it adds to these four (PA0, PA1, PC0, PC1), beside its present value."""
    gains = [_gains(model, term, rates) for term in model.system.terms if _is_parameter(term)]
    model = model.at() if gains else model
    m = model.order
    mass = scipy.linalg.cho_factor(model.system.M)
    size = _sizes(model.system)
    inner = InternalStates.of(model.system.terms, m)
    n, speeds, states = 2 * m + inner.count, slice(m, 2 * m), slice(2 * m, None)
    A0, A1, B = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, len(model.inputs)))
    A0[:m, speeds] = np.diag(size)
    A0[speeds, :m] = -scipy.linalg.cho_solve(mass, model.system.K + inner.stiffness) / size
    A0[speeds, states] = scipy.linalg.cho_solve(mass, inner.force)
    A0[states, :m], A0[states, states] = inner.drive / size, -np.diag(inner.rate)
    A1[speeds, speeds] = -scipy.linalg.cho_solve(mass, model.system.D)
    B[speeds] = scipy.linalg.cho_solve(mass, model.system.B)
    shapes = model.system.C
    zero, none = np.zeros_like(shapes), np.zeros((len(shapes), inner.count))
    C, C1, D = [], [], []
    for rate in rates:
        if rate == "displacement":
            rows = np.hstack([shapes / size, zero, none])
            added = np.hstack([zero, model.system.C_rate, none])
            direct = model.system.feedthrough
        elif rate == "velocity":
            rows, added = np.hstack([zero, shapes, none]), np.zeros((len(shapes), n))
            direct = np.zeros_like(model.system.feedthrough)
        else:
            rows, added, direct = shapes @ A0[speeds], shapes @ A1[speeds], shapes @ B[speeds]
        C.append(rows)
        C1.append(added)
        D.append(direct)
    found = {"A0": A0, "A1": A1, "B": B, "C": np.vstack(C), "C1": np.vstack(C1), "D": np.vstack(D)}
    _expect_the_body(model, rates, found)
    for k, name in enumerate(("PA0", "PA1", "PC0", "PC1")):
        found[name] = np.vstack([g[k] for g in gains]) if gains else np.zeros((1, 1))
    return found


def _is_parameter(term: Term) -> bool:
    return isinstance(term.law, Parameter)


def _gains(model: ReducedBody, term: Term, rates: Sequence[str]) -> list[Floats]:
    """What a unit of a parameter adds to A0, A1, C and C1."""
    law, now = term.law, model.system.at()
    assert isinstance(law, Parameter)
    m, n = model.order, 2 * model.order + InternalStates.of(now.terms, model.order).count
    size = _sizes(now)
    stiffer = -law.slope * scipy.linalg.cho_solve(scipy.linalg.cho_factor(now.M), term.matrix)
    A0, A1 = np.zeros((n, n)), np.zeros((n, n))
    A0[m : 2 * m, :m], A1[m : 2 * m, m : 2 * m] = stiffer / size, law.beta * stiffer
    none = np.zeros((len(now.C), n))
    parts = [
        (now.C @ A0[m : 2 * m], now.C @ A1[m : 2 * m]) if rate == "acceleration" else (none, none)
        for rate in rates
    ]
    return [A0, A1, *(np.vstack(rows) for rows in zip(*parts, strict=True))]


def _sizes(system: System) -> Floats:
    """Of each coordinate its own frequency."""
    squares = np.diag(system.K) / np.diag(system.M)
    least = 1e-12 * squares.max() if squares.max() > 0 else 1.0
    sizes: Floats = np.sqrt(np.maximum(squares, least))
    return sizes


def _expect_the_body(model: ReducedBody, rates: Sequence[str], matrices: dict[str, Floats]) -> None:
    """Rounding of stiff beside soft coordinates must not count."""
    A, C = matrices["A0"] + matrices["A1"], matrices["C"] + matrices["C1"]
    for w in (
        1.001 * model.claim.bands[0, 0] or 1e-3 * model.claim.bands[-1, 1],
        0.997 * model.claim.bands[-1, 1],
    ):
        H = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, matrices["B"]) + matrices["D"]
        expected = np.vstack(
            [(1j * w) ** RATES.index(rate) * model.system.transfer(w) for rate in rates]
        )
        if not np.linalg.norm(H - expected) <= 1e-6 * np.linalg.norm(expected):
            raise BodyError(
                "the body is too stiff beside what is soft in it for a state space in "
                "doubles: a smaller order or band"
            )


def _header(
    matrices: dict[str, Floats], parameters: Sequence[Parameter], version: int, token: str
) -> str:
    sizes = {"NX": len(matrices["A0"]), "NU": matrices["B"].shape[1], "NY": len(matrices["C"])}
    sizes["NP"] = len(parameters)
    if parameters:
        names = {"PRESENT": "value", "LEAST": "least", "MOST": "most"}
        for name, field in names.items():
            matrices[name] = np.array([[getattr(p, field) for p in parameters]])
    lines = [f"#define FMI {version}", f'#define TOKEN "{token}"']
    lines += [f"#define {name} {value}" for name, value in sizes.items()]
    for name, a in matrices.items():
        numbers = ",\n".join(", ".join(float(x).hex() for x in row) for row in a)
        lines.append(f"static const double {name}[{a.size}] = {{\n{numbers}}};")
    return "\n".join(lines) + "\n"


class _Description:
    """modelDescription.xml."""

    def __init__(
        self, model: ReducedBody, rates: Sequence[str], states: int, name: str, token: str
    ) -> None:
        self.model, self.name, self.token = model, name, token
        self.inputs = [(port, unit_of(port, False)) for port in model.inputs]
        self.outputs = [
            (port + dots, unit_of(port, True, rate))
            for rate in rates
            for dots in [
                {"velocity": ".velocity", "acceleration": ".acceleration"}.get(rate, ".motion")
            ]
            for port in model.outputs
        ]
        self.states = states
        free = " small motions only: rigid motion is linear too;" if model.frame.rigid_modes else ""
        words = "; ".join(f"{key}: {value}" for key, value in facts_of(model).items())
        self.about = f"elastic body reduced by flexgram;{free} {words}"

    def _unit_definitions(self, tag: str) -> list[str]:
        used = sorted({unit for _, unit in (*self.inputs, *self.outputs) if unit})
        lines = [
            f"    <Unit name={quoteattr(unit)}><BaseUnit {BASE[unit]}/></Unit>" for unit in used
        ]
        return [f"  <{tag}>", *lines, f"  </{tag}>"] if lines else []

    def _variables(self) -> list[tuple[str, str, dict[str, str]]]:
        """Name, causality and further attributes of each, in the order of value references."""
        result: list[tuple[str, str, dict[str, str]]] = []
        for name, unit in self.inputs:
            result.append((name, "input", {"start": "0", "unit": unit or ""}))
        for name, unit in self.outputs:
            result.append((name, "output", {"unit": unit or ""}))
        result += [(f"state[{k + 1}]", "local", {"start": "0"}) for k in range(self.states)]
        result += [(f"der(state[{k + 1}])", "local", {}) for k in range(self.states)]
        result.append(("damping_factor", "parameter", {"start": "1", "min": "0"}))
        for name, law in self.model.system.parameters.items():
            limits = {"start": law.value, "min": law.least, "max": law.most}
            result.append((name, "parameter", {key: repr(x) for key, x in limits.items()}))
        names = [name for name, *_ in result] + ["time"]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise BodyError(f"two variables of the FMU would be named {twice}: rename a port")
        return result

    def _unknowns(self, first: int) -> tuple[range, range]:
        """Outputs and derivatives of the states, where the first variable has the number first."""
        state = first + len(self.inputs) + len(self.outputs)
        return (
            range(first + len(self.inputs), state),
            range(state + self.states, state + 2 * self.states),
        )

    def _elements(self, first: int) -> list[tuple[str, str, str, str]]:
        """Of each variable: name, causality, variability with initial, and the attributes of the
        real number; a derivative names its state, where the first variable has the number first."""
        _, derivatives = self._unknowns(first)
        elements = []
        for k, (name, causality, more) in enumerate(self._variables(), start=first):
            real = {key: value for key, value in more.items() if value}
            if k in derivatives:
                real["derivative"] = str(k - self.states)
            known = "exact" if "start" in more else "calculated"
            initial = {
                "parameter": 'variability="fixed" initial="exact"',
                "input": 'variability="continuous"',
                "output": 'variability="continuous" initial="calculated"',
                "local": f'variability="continuous" initial="{known}"',
            }[causality]
            attributes = " ".join(f"{key}={quoteattr(value)}" for key, value in real.items())
            elements.append((name, causality, initial, attributes))
        return elements

    def of_version_2(self) -> str:
        capabilities = (
            f'modelIdentifier="{self.name}" canGetAndSetFMUstate="true" canSerializeFMUstate="true"'
        )
        sources = '    <SourceFiles><File name="model.c"/></SourceFiles>'
        lines = [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<fmiModelDescription fmiVersion="2.0" modelName="{self.name}" guid="{self.token}" '
            f'description={quoteattr(self.about)} generationTool="flexgram" '
            'variableNamingConvention="flat" numberOfEventIndicators="0">',
            f"  <ModelExchange {capabilities}>",
            sources,
            "  </ModelExchange>",
            f'  <CoSimulation {capabilities} canHandleVariableCommunicationStepSize="true" '
            'canInterpolateInputs="true">',
            sources,
            "  </CoSimulation>",
            *self._unit_definitions("UnitDefinitions"),
            "  <ModelVariables>",
        ]
        for k, (name, causality, initial, real) in enumerate(self._elements(first=1)):
            lines.append(
                f'    <ScalarVariable name={quoteattr(name)} valueReference="{k}" '
                f'causality="{causality}" {initial}>'
            )
            lines.append(f"      <Real {real}/></ScalarVariable>")
        lines += ["  </ModelVariables>", "  <ModelStructure>"]
        outputs, derivatives = self._unknowns(first=1)
        for tag, members in (
            ("Outputs", outputs),
            ("Derivatives", derivatives),
            ("InitialUnknowns", [*outputs, *derivatives]),
        ):
            lines += [
                f"    <{tag}>",
                *(f'      <Unknown index="{k}"/>' for k in members),
                f"    </{tag}>",
            ]
        lines += ["  </ModelStructure>", "</fmiModelDescription>"]
        return "\n".join(lines) + "\n"

    def of_version_3(self) -> str:
        capabilities = (
            f'modelIdentifier="{self.name}" canGetAndSetFMUState="true" canSerializeFMUState="true"'
        )
        lines = [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<fmiModelDescription fmiVersion="3.0" modelName="{self.name}" '
            f'instantiationToken="{self.token}" description={quoteattr(self.about)} '
            'generationTool="flexgram" variableNamingConvention="flat">',
            f"  <ModelExchange {capabilities}/>",
            f'  <CoSimulation {capabilities} canHandleVariableCommunicationStepSize="true" '
            'maxOutputDerivativeOrder="0"/>',
            *self._unit_definitions("UnitDefinitions"),
            "  <ModelVariables>",
        ]
        elements = self._elements(first=0)
        for k, (name, causality, initial, real) in enumerate(elements):
            lines.append(
                f'    <Float64 name={quoteattr(name)} valueReference="{k}" '
                f'causality="{causality}" {initial} {real}/>'
            )
        lines.append(
            f'    <Float64 name="time" valueReference="{len(elements)}" '
            'causality="independent" variability="continuous"/>'
        )
        lines += ["  </ModelVariables>", "  <ModelStructure>"]
        outputs, derivatives = self._unknowns(first=0)
        for tag, members in (
            ("Output", outputs),
            ("ContinuousStateDerivative", derivatives),
            ("InitialUnknown", [*outputs, *derivatives]),
        ):
            lines += [f'    <{tag} valueReference="{k}"/>' for k in members]
        lines += ["  </ModelStructure>", "</fmiModelDescription>"]
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
    model.system.expect_time_domain(rates)
    machine = platform.machine()
    if machine not in PLATFORMS or platform.system() != "Linux":
        raise BodyError(
            f"an FMU's binary is made for {', '.join(PLATFORMS)} on Linux, not {machine}"
        )
    name = re.sub(r"\W", "_", path.stem)
    name = name if re.match("[A-Za-z_]", name) else f"_{name}"
    token = f"{{{uuid.uuid4()}}}"
    matrices = _matrices(model, rates)
    description = _Description(model, rates, len(matrices["A0"]), name, token)
    with tempfile.TemporaryDirectory(prefix="flexgram-fmu-") as work:
        folder = Path(work)
        shutil.copyfile(SOURCE, folder / "model.c")
        laws = model.system.parameters.values()
        parameters = [law for law in laws if isinstance(law, Parameter)]
        (folder / "model_data.h").write_text(_header(matrices, parameters, version, token))
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
