"""flexgram: certified reduction of elastic bodies for multibody systems.

``import_body`` and ``importers`` make body files, ``reduce`` reduces them in this process, or
``certify`` once and ``Medium.reduce`` often; ``ReducedModel`` is the result, ``export``
hands it to multibody codes (see README.md).
"""

from typing import Any

from flexgram import moved
from flexgram.basics import BodyError, ReductionWarning
from flexgram.body.bodyfile import write_matrices
from flexgram.body.description import import_body
from flexgram.body.laws import circulatory, loss, prony, table, viscous
from flexgram.body.matrices import Matrices
from flexgram.body.varying_laws import coriolis, parameter, product, spin
from flexgram.importers.mesh import import_mesh
from flexgram.reduced_model import ReducedModel
from flexgram.reduction.direct import reduce
from flexgram.reduction.medium import Medium, certify

moved.install()

__version__ = "0.1.0"
__all__ = [
    "BodyError",
    "Matrices",
    "Medium",
    "ReducedModel",
    "ReductionWarning",
    "certify",
    "circulatory",
    "coriolis",
    "export",
    "exporters",
    "figures",
    "import_body",
    "import_mesh",
    "importers",
    "loss",
    "parameter",
    "product",
    "prony",
    "reduce",
    "spin",
    "table",
    "viscous",
    "write_matrices",
]


def __getattr__(name: str) -> Any:
    """Modules that take time to load come when they are asked for."""
    from importlib import import_module

    if name in ("exporters", "importers"):
        return import_module(f"flexgram.{name}")
    if name == "figures":
        return import_module("flexgram.pictures.figures")
    if name == "export":
        return import_module("flexgram.exporters").export
    raise AttributeError(f"module flexgram has no attribute {name}")
