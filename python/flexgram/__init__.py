"""flexgram: certified reduction of elastic bodies for multibody systems.

This package prepares body files and shows results; the work is done by the program
``flexgram`` (see README.md).
"""

from flexgram.bodyfile import write_matrices
from flexgram.description import BodyError, import_body

__all__ = ["BodyError", "import_body", "write_matrices"]
