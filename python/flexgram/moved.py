"""Names of modules of 0.1: they lead to the new ones, with a warning, for one release."""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.util
import sys
import warnings
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

MOVED = {
    "bodyfile": "body.bodyfile",
    "description": "body.description",
    "reader": "body.reader",
    "sections": "body.sections",
    "meshfile": "body.meshfile",
    "selection": "body.selection",
    "faces": "body.faces",
    "face_integrals": "body.face_integrals",
    "units": "body.units",
    "loads": "body.loads",
    "outputs": "body.outputs",
    "strain": "body.strain",
    "stress": "body.stress",
    "meshbody": "importers.mesh",
    "dolfinx": "importers.dolfinx",
    "reduced": "model.reduced",
    "reduced_file": "model.file",
    "response": "model.response",
    "elastic_part": "model.elastic_part",
    "physical": "model.physical",
    "geometry": "model.geometry",
    "error_form": "model.error_form",
    "api": "reduction.direct",
    "call": "reduction.call",
    "medium": "reduction.medium",
    "couple": "assembly.couple",
    "joints": "assembly.joints",
    "assembly_claim": "assembly.claim",
    "small_gain": "assembly.small_gain",
    "gain_over_band": "assembly.gain_over_band",
    "form_over_band": "assembly.form_over_band",
    "band_bound": "assembly.band_bound",
    "loop_series": "assembly.loop_series",
    "interval_series": "assembly.interval_series",
    "expressions": "simulation.expressions",
    "histories": "simulation.histories",
    "hot_spots": "simulation.hot_spots",
    "frf": "measured.frf",
    "mode_shapes": "measured.mode_shapes",
    "universal": "body.universal",
    "figures": "pictures.figures",
    "plots": "pictures.plots",
    "report": "pictures.report",
    "commands": "cli.commands",
    "port_commands": "cli.port_commands",
    "import_command": "cli.import_command",
    "info": "cli.info",
}


class Moved(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds ``flexgram.couple`` where ``flexgram.assembly.couple`` is."""

    _own: ModuleSpec | None = None

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        package, _, module = name.partition(".")
        if package != "flexgram" or module not in MOVED:
            return None
        return importlib.util.spec_from_loader(name, self)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        new = f"flexgram.{MOVED[spec.name.partition('.')[2]]}"
        warnings.warn(f"{spec.name} is {new} now", DeprecationWarning, stacklevel=2)
        module = importlib.import_module(new)
        self._own = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """It has run, and keeps its own name."""
        module.__spec__ = self._own


def install() -> None:
    if not any(isinstance(finder, Moved) for finder in sys.meta_path):
        sys.meta_path.append(Moved())
