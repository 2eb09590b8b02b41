"""What users hold: a reduced body with all that can be done with it."""

from __future__ import annotations

import html
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexgram.basics import BodyError, ComplexArray, Floats, ReductionWarning
from flexgram.model import elastic_part, recovery
from flexgram.model.physical import PhysicalForm, physical_form
from flexgram.model.reduced import ReducedBody

#: Parts that hold the names of 0.1 (``rom.M`` is ``rom.system.M``), and names that are others now.
PARTS = ("system", "claim", "basis", "provenance")
RENAMED = {"certified_error": "supremum", "whole_error": "whole", "attained_error": "attained"}


class ReducedModel(ReducedBody):
    """A reduced elastic body ``M q'' + D q' + K (1 + i eta) q = B u``, ``y = C q`` (reactions and
    stress from a temperature have further terms, see ``System``).

    Made by ``flexgram.reduce`` or read by ``ReducedModel.load``. It is made of parts, which
    ``flexgram.model`` describes: ``system`` (matrices, ports), ``claim`` (what is claimed of the
    error), ``basis`` (V and its nodes), ``frame``, ``provenance``. Their attributes are its own
    too: ``rom.K`` is ``rom.system.K``.
    """

    def __getattr__(self, name: str) -> Any:
        """An attribute of one of its parts."""
        known = RENAMED.get(name, name)
        if known == "C":
            self._warn_of_outputs()
        if not known.startswith("_"):
            for part in (self.__dict__.get(part) for part in PARTS):
                if hasattr(part, known):
                    return getattr(part, known)
        raise AttributeError(f"{type(self).__name__} has no attribute {name}")

    def _warn_of_outputs(self) -> None:
        system = self.system
        rows = np.flatnonzero(system.feedthrough.any(axis=1) | (system.output_beta != 0))
        if len(rows):
            warnings.warn(
                f"C q alone is not {system.outputs[rows[0]]} (nor {len(rows) - 1} other outputs): "
                "add feedthrough u and output_beta C q', as transfer, simulate and state_space do",
                ReductionWarning,
                stacklevel=3,
            )

    def __setattr__(self, name: str, value: Any) -> None:
        """Of a part's attribute: a part with another one."""
        known = RENAMED.get(name, name)
        for part in PARTS:
            if known in getattr(self.__dict__.get(part), "__dataclass_fields__", {}):
                name, value = part, replace(self.__dict__[part], **{known: value})
                break
        super().__setattr__(name, value)

    def transfer(self, omega: ArrayLike, feedthrough: bool = True) -> ComplexArray:
        """``system.transfer``: H_r at frequencies [rad/s], (n_out, n_in) or (n, n_out, n_in).

        Examples
        --------
        >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
        >>> rom.transfer(2 * np.pi * np.array([50.0, 100.0])).shape
        (2, 12, 12)
        """
        return self.system.transfer(omega, feedthrough)

    def simulate(
        self,
        u: Callable[[float], ArrayLike] | ArrayLike,
        t: ArrayLike,
        q0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        rates: Sequence[str] = ("displacement",),
    ) -> tuple[Floats, Floats]:
        """``system.simulate``: outputs and coordinates at times t [s] under forces u [N, N m].

        Examples
        --------
        >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
        >>> t = np.linspace(0, 0.1, 201)
        >>> push = np.zeros(len(rom.inputs))
        >>> push[rom.inputs.index("upper.fx")] = 100.0
        >>> y, q = rom.simulate(lambda time: push, t)
        >>> y.shape == (201, len(rom.outputs))
        True
        """
        return self.system.simulate(u, t, q0, v0, rates)

    def state_space(
        self, rates: Sequence[str] = ("displacement",)
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """``system.state_space``: A, B, C, D of x' = A x + B u, y = C x + D u, x = [q, q'].

        Examples
        --------
        >>> A, B, C, D = flexgram.ReducedModel.load("rack.rom.h5").state_space()
        >>> A.shape[0] == 2 * flexgram.ReducedModel.load("rack.rom.h5").order
        True
        """
        return self.system.state_space(rates)

    def poles(self) -> ComplexArray:
        """``system.poles``: the 2m poles s [rad/s] without structural damping.

        Examples
        --------
        >>> s = flexgram.ReducedModel.load("rack.rom.h5").poles()
        >>> first = s[s.imag > 1].imag.min() / (2 * np.pi)
        >>> print(f"{first:.1f} Hz")
        105.5 Hz
        """
        return self.system.poles()

    def lift(self, q: ArrayLike) -> Floats:
        """``basis.lift``: displacements V q of the full body, (…, m) -> (…, rows of V).

        Examples
        --------
        >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
        >>> rom.lift(np.eye(rom.order)[6]).shape == (len(rom.basis.V),)
        True
        """
        return self.basis.lift(q)

    def principal(
        self,
        q: ArrayLike | None = None,
        body: str | Path | None = None,
        u: ArrayLike | None = None,
        side: str = "",
    ) -> Floats:
        """Principal stresses at the nodes, (k, N, 3) [N/m²], descending; as ``stress``.

        Examples
        --------
        >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
        >>> rom.principal().shape[::2] == (rom.order, 3)
        True
        """
        return recovery.principal_stress_at_nodes(self, q, body, u, side)

    def stress(
        self,
        q: ArrayLike | None = None,
        body: str | Path | None = None,
        u: ArrayLike | None = None,
        side: str = "",
    ) -> Floats:
        """Stress at the nodes of a body that flexgram assembled, (k, N, 6) [N/m²].

        Of the elements' own strain, averaged at nodes (``flexgram.body.stress``): xx, yy, zz, xy,
        yz, zx; NaN at nodes of no deforming solid, or shell. Nothing is claimed of it but of
        ``outputs`` of the type stress; their values are these.

        Parameters
        ----------
        q : (k, m) array, optional
            Generalised coordinates; default: each basis vector.
        body : str or Path, optional
            Body file; default: the one that was reduced, if it is there.
        u : (k, n_in) array, optional
            Inputs at the same moments: needed if one of them is a temperature.
        side : str
            That of shells: ``top``, ``middle`` or ``bottom``. Where shells of different sections
            meet, or meet at an angle, a node has the stress of those with the largest von Mises
            stress. Default: solids. ``larger``: of solids, and of shells that of their top or
            bottom.

        Raises
        ------
        BodyError
            Without that file, or if it holds matrices; without ``u`` where heat strains the body;
            without ``side`` where there are shells alone.

        Examples
        --------
        >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
        >>> rom.stress().shape[::2] == (rom.order, 6)
        True
        """
        return recovery.stress_at_nodes(self, q, body, u, side)

    def physical(self) -> PhysicalForm:
        """The same body in the motions of its interfaces and the modes with these held, as
        superelements are.

        Raises
        ------
        BodyError
            If its coordinates do not hold every motion of its interfaces by itself.

        Examples
        --------
        >>> form = flexgram.ReducedModel.load("rack.rom.h5").physical()
        >>> form.boundary[:3], form.K.shape == form.M.shape
        (['lower.fx', 'lower.fy', 'lower.fz'], True)
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
            (``--frame none``, ``pod`` of a free body).

        Examples
        --------
        >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
        >>> rom.order - rom.elastic().order  # six rigid modes
        6
        """
        return elastic_part.in_its_frame(self)

    def without_rigid_modes(self) -> ReducedModel:
        """The body without its rigid modes, whatever its frame: the elastic part of H, stress too.

        Raises
        ------
        BodyError
            If dampers mix rigid and elastic modes.

        Examples
        --------
        >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
        >>> part = rom.without_rigid_modes()
        >>> bool(part.modes.min() > 2 * np.pi * 100)  # [rad/s]
        True
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

        Examples
        --------
        >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
        >>> figure = rom.plot("transfer", "transfer.png", ports=[("upper.fz", "upper.fz")])
        """
        from flexgram.pictures import figures  # matplotlib is slow to load

        if figure not in figures.FIGURES:
            raise BodyError(f"plot: {figure} must be one of {', '.join(figures.FIGURES)}")
        drawn = figures.FIGURES[figure](self, **options)
        if path is not None:
            figures.save(drawn, Path(path))
        return drawn

    def _repr_html_(self) -> str:
        """For notebooks: order, method, band, error, inputs and warnings."""
        rows = len(self.basis.V)
        shown = {
            "order": f"{self.order} of {rows:,}" if rows else str(self.order),
            "method": self.provenance.stages,
            "band": ", ".join(f"{a:g} to {b:g} Hz" for a, b in self.claim.bands / (2 * np.pi)),
            "error": self.claim.words,
            "inputs": ", ".join(self.inputs),
        }
        told = [*shown.items(), *(("warning", text) for text in self.provenance.warnings)]
        lines = (
            f"<tr><th>{key}</th><td style='text-align:left'>{html.escape(value)}</td></tr>"
            for key, value in told
        )
        return f"<table>{''.join(lines)}</table>"
