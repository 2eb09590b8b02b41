"""``flexgram.reduce``: the reduction in this process, on the caller's communicator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

from flexgram.body.matrices import Matrices
from flexgram.reduced_model import ReducedModel
from flexgram.reduction.call import (
    communicator,
    core,
    hand_over,
    option_values,
    pass_warnings_on,
    reduced,
)
from flexgram.reduction.options import ReduceOptions


def reduce(
    body: str | Path | Matrices,
    band_hz: Sequence[float] | Sequence[tuple[float, float]] = (10.0, 500.0),
    tol: float | None = None,
    *,
    order: int | str | None = None,
    method: str = "two_step",
    comm: Any = None,
    options: Mapping[str, Any] | None = None,
    verbose: bool = False,
    **keywords: Unpack[ReduceOptions],
) -> ReducedModel:
    """Reduce an elastic body over a frequency band, with a proof of the error.

    Parameters
    ----------
    body : str, Path or Matrices
        Body file (matrices or a mesh, see ``flexgram.import_body``), or matrices in memory.
    band_hz : sequence of float, or of pairs
        First and last frequency [Hz], or one, (50,); several as (10, 100, 200, 300) or in pairs.
    tol : float, optional
        Largest relative error of H over the band (eq. 17), and of its elastic part if the body is
        free (``mor_tol_relative_to``). The smallest certified order that meets it is taken. Without
        ``tol`` and ``order`` 1e-3, but for methods with an order of their own (``modal``: the modes
        in the band) and ``pod`` (the paper's rule).
    order : int or str, optional
        Order of the reduced body instead of a tolerance; ``"rule"``: by the paper's rule.
    method : str
        ``two_step``, ``pod``, ``modal``, ``craig_bampton``, ``krylov``, ``irka``, ``balanced``.
    comm : mpi4py communicator, optional
        Default: ``MPI.COMM_WORLD``. Every rank of it must call.
    options : mapping, optional
        PETSc's own options, with or without ``-``, and any of the program:
        ``{"mor_mumps_icntl_14": 50}``.
    verbose : bool
        Print the plan and progress as the program does.
    **keywords
        Options of the program by their names without ``-mor_`` (``ReduceOptions``):
        ``second_stage="optimal"``, ``frame="tangent"``, ``statics=True``,
        ``relative_to="elastic"``, ``load_patterns=100`` for hundreds of ports and more.

    Returns
    -------
    ReducedModel
        Its ``V`` has the rows of this rank. If the tolerance cannot be met, ``met`` is False, the
        best body found is returned with the error that it is certified to, and a warning says why.

    Warns
    -----
    ReductionWarning
        Of all that ``provenance.warnings`` holds, on the first rank.

    Raises
    ------
    BodyError
        On every rank, with the message of the program.
    TypeError
        For a keyword that is no option.

    Examples
    --------
    >>> rom = flexgram.reduce("rack.h5", (10, 500), tol=1e-4, statics=True)
    >>> rom.claim.met
    True
    """
    values = option_values(band_hz, tol, order, method, options, verbose, keywords, ReduceOptions)
    world = communicator(comm)
    given = hand_over(body, world, values)
    result = core().reduce(world.py2f(), given, values)
    model = reduced(result)
    pass_warnings_on(model.provenance.warnings, world)
    return model
