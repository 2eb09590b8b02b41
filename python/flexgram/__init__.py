"""flexgram: certified reduction of elastic bodies for multibody systems.

``import_body`` and ``importers`` make body files, ``reduce`` reduces them in this process, or
``certify`` once and ``Medium.reduce`` often; ``ReducedModel`` is the result, ``export``
hands it to multibody codes (see README.md).
"""

from flexgram.api import reduce
from flexgram.basics import BodyError
from flexgram.bodyfile import write_matrices
from flexgram.call import Matrices
from flexgram.description import import_body
from flexgram.medium import Medium, certify
from flexgram.reduced import ReducedModel

__all__ = [
    "BodyError", "Matrices", "Medium", "ReducedModel", "certify", "import_body", "reduce",
    "write_matrices",
]  # fmt: skip
