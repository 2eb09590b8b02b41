"""``flexgram.certify`` and ``Medium``: one certified medium model, any number of small bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import numpy as np

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
from flexgram.reduction.options import CertifyOptions, CutOptions


class Medium:
    """A certified medium model: what small bodies are cut from, without the full body.

    Attributes
    ----------
    n, order : int
        Size of the full body, and of the medium model.
    bands : (k, 2) array
        Where it is certified [rad/s].
    target : float
        Certified relative error of this model. Tolerances of reduced bodies should be at least
        fifty times as large.
    reached : bool
        Whether it is; ``claim`` says so in words.
    cutoff : float
        All ``modes`` elastic modes below it are held [rad/s].
    mode_omega, mode_error : (modes,) arrays
        Their natural frequencies without damping and terms [rad/s], and by how much, relative, the
        body's are lower at most (docs/proof.md, section 4).
    inputs, outputs : list of str
        Port names.
    plan : list of (str, str)
        What was done and what was skipped to make it; empty after ``load``.
    warnings : list of str
        What was warned of; empty after ``load``.
    """

    def __init__(self, held: Any, comm: Any) -> None:
        self._held, self._comm = held, comm
        fields = held.fields()
        self.n, self.order = int(fields["n"]), int(fields["order"])
        self.bands = np.asarray(fields["bands"], dtype=float).reshape(-1, 2)
        self.target, self.reached = float(fields["target"]), bool(fields["reached"])
        self.claim = str(fields["claim"])
        self.cutoff, self.modes = float(fields["cutoff"]), int(fields["modes"])
        self.rigid_modes = int(fields["rigid_modes"])
        self.mode_omega = np.asarray(fields["mode_omega"], dtype=float)
        self.mode_error = np.asarray(fields["mode_error"], dtype=float)
        self.inputs: list[str] = list(fields["inputs"])
        self.outputs: list[str] = list(fields["outputs"])
        self.body = str(fields["body"])
        self.has_basis = bool(fields["has_basis"])
        self.plan: list[tuple[str, str]] = list(fields["plan"])
        self.warnings: list[str] = list(fields["warnings"])

    def __repr__(self) -> str:
        words = ", ".join(f"{first:.6g}-{last:.6g}" for first, last in self.bands / (2 * np.pi))
        return (
            f"<Medium of order {self.order} of n = {self.n}, {len(self.inputs)} inputs, "
            f"{self.claim}, over {words} Hz>"
        )

    def reduce(
        self,
        tol: float | None = None,
        *,
        order: int | str | None = None,
        method: str = "two_step",
        band_hz: Sequence[float] | Sequence[tuple[float, float]] | None = None,
        options: Mapping[str, Any] | None = None,
        verbose: bool = False,
        **keywords: Unpack[CutOptions],
    ) -> ReducedModel:
        """Cut a small body out of the medium model: dense work, the error proved as ever.

        Parameters
        ----------
        tol, order, method, options, verbose
            As for ``flexgram.reduce`` (every method but ``pod``).
        band_hz : sequence of float, optional
            Within what the medium model is certified for; default: its bands.
        **keywords
            Options of the program by their names without ``-mor_`` (``CutOptions``):
            ``inputs=["lower"]``, ports or interfaces to keep; ``second_stage="optimal"``.

        Returns
        -------
        ReducedModel
            Equal to rounding to what ``flexgram.reduce`` gives for the same request.

        Raises
        ------
        BodyError
            If the medium model holds too little for the request, with what to certify.

        Examples
        --------
        >>> medium = flexgram.certify("rack.h5", (10, 500), tol=1e-3)
        >>> upper = medium.reduce(1e-2, inputs=["upper"])
        >>> upper.inputs
        ['upper.fx', 'upper.fy', 'upper.fz', 'upper.mx', 'upper.my', 'upper.mz']
        >>> upper.claim.supremum <= 1e-2
        True
        """
        values = option_values(band_hz, tol, order, method, options, verbose, keywords, CutOptions)
        result = self._held.cut(values)
        model = reduced(result)
        pass_warnings_on(model.provenance.warnings, self._comm)
        return model

    def save(self, path: str | Path, basis: bool = True) -> None:
        """Write the file that ``flexgram cut`` and ``load`` read; without the basis it is small,
        and bodies cut from it have no shapes. Collective.

        Examples
        --------
        >>> medium = flexgram.certify("rack.h5", (10, 500), tol=1e-3)
        >>> medium.save("small.medium.h5", basis=False)
        >>> flexgram.Medium.load("small.medium.h5").reduce(1e-2).basis.V.size
        0
        """
        self._held.save(str(path), basis)

    @classmethod
    def load(cls, path: str | Path, comm: Any = None) -> Medium:
        """Read a medium model that ``save`` or ``flexgram certify`` wrote. Collective.

        Raises
        ------
        BodyError
            If the file is none, damaged, or of another version.

        Examples
        --------
        >>> flexgram.certify("rack.h5", (10, 500), tol=1e-3).save("rack.medium.h5")
        >>> flexgram.Medium.load("rack.medium.h5").inputs[:2]
        ['lower.fx', 'lower.fy']
        """
        world = communicator(comm)
        return cls(core().load_medium(world.py2f(), str(path)), world)


def certify(
    body: str | Path | Matrices,
    band_hz: Sequence[float] | Sequence[tuple[float, float]] = (10.0, 500.0),
    tol: float | None = None,
    *,
    order: int | str | None = None,
    method: str = "two_step",
    comm: Any = None,
    options: Mapping[str, Any] | None = None,
    verbose: bool = False,
    **keywords: Unpack[CertifyOptions],
) -> Medium:
    """The first of two steps: a medium model of the body and the proof of its error.

    Parameters
    ----------
    body, band_hz, comm, options, verbose, **keywords
        As for ``flexgram.reduce`` (``CertifyOptions``).
    tol : float, optional
        The tightest tolerance that small bodies will be asked for; looser ones cost nothing more.
    order, method
        For what ``method`` needs of the medium model: ``modal`` of order m that many modes.

    Returns
    -------
    Medium
        ``medium.reduce(tol=...)`` takes milliseconds.

    Raises
    ------
    BodyError
        On every rank, with the message of the program.

    Warns
    -----
    ReductionWarning
        Of all that ``warnings`` holds, on the first rank.

    Examples
    --------
    >>> medium = flexgram.certify("rack.h5", (10, 500), tol=1e-4)
    >>> medium.reached
    True
    >>> loose, tight = (medium.reduce(tol) for tol in (1e-2, 1e-4))
    >>> loose.order < tight.order < medium.order
    True
    """
    values = option_values(band_hz, tol, order, method, options, verbose, keywords, CertifyOptions)
    world = communicator(comm)
    given = hand_over(body, world, values)
    medium = Medium(core().certify(world.py2f(), given, values), world)
    pass_warnings_on(medium.warnings, world)
    return medium
