"""What users hold: a reduced body with all that can be done with it."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError
from flexgram.model import elastic_part, recovery
from flexgram.model.physical import PhysicalForm, physical_form
from flexgram.model.reduced import Floats, ReducedBody

#: Names of 0.1 for what ``claim`` holds.
OF_CLAIM = {"certified_error": "supremum", "whole_error": "whole", "attained_error": "attained"}


class ReducedModel(ReducedBody):
    """A reduced elastic body ``M q'' + D q' + K (1 + i eta) q = B u``, ``y = C q``.

    Made by ``flexgram.reduce`` or read by ``ReducedModel.load``. What is claimed of its error is
    ``claim`` (``flexgram.model.claim.Claim``), whose attributes are its own too.
    """

    def __getattr__(self, name: str) -> Any:
        """An attribute of ``claim``."""
        claim = self.__dict__.get("claim")
        known = OF_CLAIM.get(name, name)
        if claim is None or known.startswith("_") or not hasattr(claim, known):
            raise AttributeError(f"{type(self).__name__} has no attribute {name}")
        return getattr(claim, known)

    def stress(
        self,
        q: ArrayLike | None = None,
        body: str | Path | None = None,
        u: ArrayLike | None = None,
    ) -> Floats:
        """Stress at the nodes of a body that flexgram assembled, (k, N, 6) [N/m²].

        Of the elements' own strain, averaged at nodes (``flexgram.body.stress``): xx, yy, zz, xy,
        yz, zx; NaN at nodes of no deforming solid. Nothing is claimed of it but of ``outputs`` of
        the type stress; their values are these.

        Parameters
        ----------
        q : (k, m) array, optional
            Generalised coordinates; default: each basis vector.
        body : str or Path, optional
            Body file; default: the one that was reduced, if it is there.
        u : (k, n_in) array, optional
            Inputs at the same moments: needed if one of them is a temperature.

        Raises
        ------
        BodyError
            Without that file, or if it holds matrices; without ``u`` where heat strains the body.
        """
        return recovery.stress_at_nodes(self, q, body, u)

    def physical(self) -> PhysicalForm:
        """The same body in the motions of its interfaces and the modes with these held, as
        superelements are.

        Raises
        ------
        BodyError
            If its coordinates do not hold every motion of its interfaces by itself.
        """
        return physical_form(self)

    def elastic(self) -> ReducedModel:
        """The body in its own frame: without the rigid basis vectors. In a frame that is not
        ``buckens`` these are coupled with the others: no elastic part by itself
        (``without_rigid_modes``).

        Damping of the rigid motion by ``alpha M`` is left out.

        Raises
        ------
        BodyError
            If dampers hold the body against the ground, or if rigid motion is mixed into the basis
            (``-mor_frame none``, ``pod`` of a free body).
        """
        return elastic_part.in_its_frame(self)

    def without_rigid_modes(self) -> ReducedModel:
        """The body without its rigid modes, whatever its frame: the elastic part of H, stress too.

        Raises
        ------
        BodyError
            If dampers mix rigid and elastic modes.
        """
        return elastic_part.without_rigid_modes(self)

    def plot(self, figure: str = "error", path: str | Path | None = None, **options: Any) -> Any:
        """Draw ``error``, ``gramian``, ``transfer``, ``stages`` or ``shapes``.

        Parameters
        ----------
        figure : str
            Which one; ``flexgram.figures`` has their options (``sweep``, ``ports``, ``body``).
        path : str or Path, optional
            Write it there, as ``.png``, ``.svg`` or ``.pdf``.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from flexgram.pictures import figures  # matplotlib is slow to load

        if figure not in figures.FIGURES:
            raise BodyError(f"plot: {figure} must be one of {', '.join(figures.FIGURES)}")
        drawn = figures.FIGURES[figure](self, **options)
        if path is not None:
            figures.save(drawn, Path(path))
        return drawn

    def _repr_html_(self) -> str:
        """For notebooks: order, method, band, error and inputs."""
        rows = {
            "order": f"{self.order} of {len(self.V):,}" if len(self.V) else str(self.order),
            "method": f"{self.method} ({self.second_stage})" if self.second_stage else self.method,
            "band": ", ".join(f"{a:g} to {b:g} Hz" for a, b in self.claim.bands / (2 * np.pi)),
            "error": self.claim.words,
            "inputs": ", ".join(self.inputs),
        }
        lines = (f"<tr><th>{key}</th><td style='text-align:left'>{html.escape(value)}</td></tr>"
                 for key, value in rows.items())  # fmt: skip
        return f"<table>{''.join(lines)}</table>"
