"""flexgram: certified reduction of elastic bodies for multibody systems.

``import_body`` and ``importers`` make body files, ``reduce`` reduces them in this process, or
``certify`` once and ``Medium.reduce`` often; ``ReducedModel`` is the result, ``export``
hands it to multibody codes (see README.md).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from flexgram import moved

if TYPE_CHECKING:
    from flexgram.basics import BodyError, ReductionWarning
    from flexgram.body.bodyfile import write_matrices
    from flexgram.body.description import import_body
    from flexgram.body.laws import circulatory, loss, prony, table, viscous
    from flexgram.body.matrices import Matrices
    from flexgram.body.varying_laws import coriolis, parameter, product, spin
    from flexgram.exporters import export
    from flexgram.importers.decks import import_deck
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
    "import_deck",
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


#: Where each name comes from: modules take time to load, and are when they are asked for.
_FROM = {
    "basics": ("BodyError", "ReductionWarning"),
    "body.bodyfile": ("write_matrices",),
    "body.description": ("import_body",),
    "body.laws": ("circulatory", "loss", "prony", "table", "viscous"),
    "body.matrices": ("Matrices",),
    "body.varying_laws": ("coriolis", "parameter", "product", "spin"),
    "exporters": ("export",),
    "importers.decks": ("import_deck",),
    "importers.mesh": ("import_mesh",),
    "reduced_model": ("ReducedModel",),
    "reduction.direct": ("reduce",),
    "reduction.medium": ("Medium", "certify"),
}
_MODULE_OF = {name: module for module, names in _FROM.items() for name in names}


def __getattr__(name: str) -> Any:
    if name in ("exporters", "importers"):
        return import_module(f"flexgram.{name}")
    if name == "figures":
        return import_module("flexgram.pictures.figures")
    if name not in _MODULE_OF:
        raise AttributeError(f"module flexgram has no attribute {name}")
    found = globals()[name] = getattr(import_module(f"flexgram.{_MODULE_OF[name]}"), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
