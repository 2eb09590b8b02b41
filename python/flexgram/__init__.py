"""flexgram: certified reduction of elastic bodies for multibody systems.

``import_body`` and ``importers`` make body files, ``reduce`` reduces them in this process,
``ReducedModel`` is the result, ``export`` hands it to multibody codes (see README.md).
"""

from flexgram.api import Matrices, reduce
from flexgram.bodyfile import write_matrices
from flexgram.description import BodyError, import_body
from flexgram.reduced import ReducedModel

__all__ = ["BodyError", "Matrices", "ReducedModel", "import_body", "reduce", "write_matrices"]
