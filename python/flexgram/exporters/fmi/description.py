"""The modelDescription.xml of a functional mock-up unit."""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

from flexgram.basics import BodyError
from flexgram.model.kinds import unit_of
from flexgram.model.physical import facts_of
from flexgram.model.reduced import ReducedBody

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


class Description:
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
