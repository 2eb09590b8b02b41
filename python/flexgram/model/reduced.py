"""The reduced body: a system, what is claimed of it, its basis, its frame, how it was made."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats, errors_of, expect_survival, written_aside
from flexgram.body.bodyfile import write_law
from flexgram.body.varying_laws import Varying
from flexgram.model.basis import Basis
from flexgram.model.claim import Claim
from flexgram.model.file import copy_file, read_fields
from flexgram.model.frame import Frame
from flexgram.model.modes import natural_modes
from flexgram.model.provenance import Provenance
from flexgram.model.system import System


def _save_at(
    save: Callable[[str], None], path: str, body: ReducedBody, terms: Collection[str]
) -> None:
    """The file of a body with parameters, with the matrices and the claim of it at values, without
    the terms that depend on them."""
    with written_aside(path) as place:
        save(str(place))
        with h5py.File(place, "r+") as file:
            for name in terms:
                del file[f"terms/{name}"]
            for term in body.system.terms:
                if term.name in terms:  # no parameter multiplies it any more
                    file[f"terms/{term.name}"] = term.matrix
                    write_law(file[f"terms/{term.name}"], term.law)
            if not len(file["terms"]):
                del file["terms"]
            for name in ("K", "D", "S"):
                matrix = getattr(body.system, name)
                if name in file:
                    file[name][...] = matrix
                elif matrix.any():
                    file[name] = matrix
            for name in ("alpha", "beta"):  # D is no longer that of these and K
                if name in file.attrs:
                    file.attrs[name] = 0.0
            file["modes/omega"][...] = body.modes[: len(file["modes/omega"])]
            error = file["error"]
            error.attrs["chosen"] = body.claim.chosen
            error.attrs["chosen_names"] = body.claim.chosen_names
            for name, value in {
                "kind": body.claim.kind,
                "worst": body.claim.supremum,
                "whole": body.claim.whole,
                "attained": body.claim.attained,
                "at": body.claim.attained_at,
                "by_kind": body.claim.by_kind,
                "kind_least": body.claim.kind_least,
            }.items():
                if name in error.attrs:
                    error.attrs[name] = value
            if not len(body.claim.bound):
                for name in ("bound", "floor", "data_rounding"):
                    if name in error:
                        del error[name]
                error["relative"][...] = body.claim.error
            if body.claim.tolerance is None:
                for name in ("tolerance", "met"):
                    error.attrs.pop(name, None)
                if "unmet" in error:
                    del error["unmet"]


class ReducedBody:
    """A reduced elastic body, of parts: whoever draws, writes or recovers takes those it needs.

    What it can do for users stands in ``flexgram.ReducedModel``.

    Attributes
    ----------
    system : System
        Matrices, ports, responses.
    claim : Claim
        What is claimed of the error.
    basis : Basis
        What the coordinates do at the nodes.
    frame : Frame
        Frame of reference, integrals of a floating one.
    provenance : Provenance
        Method, plan, warnings, times.
    sigma : array
        Eigenvalues of the position Gramian, descending.
    modes : array
        Undamped eigenfrequencies of the reduced body [rad/s].
    path : Path or None
        Where it was read from.
    """

    def __init__(self, fields: dict[str, Any], save: Callable[[str], None] | None) -> None:
        self.system = System.of(fields)
        self.claim = Claim.of(fields, len(self.system.inputs))
        self.basis = Basis.of(fields)
        self.frame = Frame.of(fields)
        self.provenance = Provenance.of(fields)
        self.sigma = np.asarray(fields.get("gramian/sigma", []), dtype=np.float64)
        self.modes = np.asarray(fields.get("modes/omega", []), dtype=np.float64)
        self._save = save
        #: Stress of the basis vectors by the file that it is of (``recovery``).
        self.recovered: tuple[Any, dict[str, Any]] | None = None
        self.path: Path | None = None

    @classmethod
    def load(cls, path: str | Path, basis: bool = True) -> Self:
        """Read a reduced file.

        Parameters
        ----------
        path : str or Path
            What ``flexgram reduce`` or ``save`` wrote.
        basis : bool
            Read V too, the only large part.

        Raises
        ------
        BodyError
            If the file is missing or no reduced file.

        Examples
        --------
        >>> flexgram.ReducedModel.load("rack.rom.h5").frame.kind
        'buckens'
        """
        source = Path(path)
        if not source.exists():
            raise BodyError(f"{source}: no such file")
        if not h5py.is_hdf5(source):
            raise BodyError(f"{source}: not an HDF5 file")
        expect_survival(source, lambda: read_fields(source, False))
        with errors_of(source):
            fields = read_fields(source, basis)
            model = cls(fields, lambda target: copy_file(source, Path(target)))
        model.path = source
        return model

    @property
    def order(self) -> int:
        """Number m of generalised coordinates."""
        return self.system.order

    @property
    def inputs(self) -> list[str]:
        """Names of the input ports."""
        return self.system.inputs

    @property
    def outputs(self) -> list[str]:
        """Names of the output ports."""
        return self.system.outputs

    @property
    def elastic_frequencies(self) -> Floats:
        """``modes`` without rigid ones, and without directions that have no mass, whose frequencies
        are nothing but rounding [rad/s]."""
        last = self.claim.band[-1]
        heavy = self.modes[self.modes < 1e7 * last]
        found: Floats = heavy[heavy > 1e-6 * min(heavy.max(initial=1e-300), last)]
        return found

    def __repr__(self) -> str:
        count = len(self.provenance.warnings)
        more = f", {count} warning{'s' if count > 1 else ''}" if count else ""
        return (
            f"<{type(self).__name__} of order {self.order} by {self.provenance.method}, "
            f"{len(self.inputs)} inputs, {self.claim.words}{more}>"
        )

    def __getstate__(self) -> dict[str, Any]:
        """For pickle and copy: all numbers; what wrote the file of this one stays behind."""
        own = replace(self.basis, V=np.array(self.basis.V))
        return self.__dict__ | {"_save": None, "basis": own}

    def with_parts(self, **parts: Any) -> Self:
        """A copy with other parts: of fewer vectors, or of other ports.

        Examples
        --------
        >>> from dataclasses import replace
        >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
        >>> soft = rom.with_parts(system=replace(rom.system, K=0.9 * rom.system.K))
        >>> bool(soft.system.K[-1, -1] < rom.system.K[-1, -1])
        True
        """
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__ | parts)
        other.recovered = None
        return other

    def at(self, **values: float) -> Self:
        """The body with values of its parameters, which it has no more: no work, no further error
        than the claim's.

        The claim is proved with the values in ``claim.parameter_values``, and with all others where
        there are ``claim.all_values``; else ``claim`` says that nothing is proved with the values.

        Parameters
        ----------
        **values : float
            By the names of the parameters (``system.parameters``), in SI units; parameters that are
            not named have their present values.

        Raises
        ------
        BodyError
            For a name that is no parameter, or a value that is not between its two numbers.

        Examples
        --------
        >>> import scipy.sparse as sp
        >>> K, M = sp.diags([2.0, 9.0, 16.0]).tocsr(), sp.identity(3).tocsr()
        >>> T = sp.diags([1.0, 0.0, 0.0]).tocsr()
        >>> terms = {"k": (T, flexgram.parameter(1.0, 3.0))}  # K with k = 1, T of k = 1
        >>> body = flexgram.Matrices(K, M, np.ones((3, 1)), eta=0.01, terms=terms)
        >>> rom = flexgram.reduce(body, (0.01, 0.4), 1e-6)
        >>> print(f"{rom.at(k=1.0).modes[0]:.4f} {rom.at(k=3.0).modes[0]:.4f} rad/s")
        1.4142 2.0000 rad/s
        """
        known = self.system.parameters
        system = self.system.at(values)
        if not known:
            return self.with_parts()
        given = {name: float(values.get(name, law.value)) for name, law in known.items()}
        squares = natural_modes(system.K, system.M)[0]
        other = self.with_parts(
            system=system,
            claim=self.claim.at(given),
            modes=np.sqrt(np.maximum(squares[np.isfinite(squares)], 0)),
        )
        save, ranks = self._save, int(self.provenance.log.get("ranks", 1))
        other._save = None
        if save and (self.path or ranks == 1):  # else save, then `flexgram at`
            varying = [t.name for t in self.system.terms if isinstance(t.law, Varying)]
            other._save = lambda path: _save_at(save, path, other, varying)
        return other

    def save(self, path: str | Path) -> None:
        """Write the reduced file; collective on the communicator of ``reduce``.

        Examples
        --------
        >>> rom = flexgram.reduce("rack.h5", (10, 500), tol=1e-2)
        >>> rom.save("loose.rom.h5")
        """
        if self._save is None:
            raise BodyError(
                "a copied or unpickled body has no file of its own: export it "
                "(flexgram.export), or save the original"
            )
        self._save(str(path))
