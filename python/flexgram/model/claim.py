"""What is claimed of a reduced body's error, in numbers and in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np

from flexgram.basics import Floats
from flexgram.model.error_form import ErrorForm
from flexgram.model.kinds import CROSSED


class Held(NamedTuple):
    """A body held at one interface (``Claim.held``)."""

    omega: Floats
    compliance: float  # nan: no port is free
    port: str

    @property
    def frequency_error(self) -> float:
        """Largest relative error of the frequencies."""
        return float(np.abs(self.omega[:, 0] / self.omega[:, 1] - 1).max(initial=0))


def held_of(fields: dict[str, Any]) -> dict[str, Held]:
    """What the group /held says."""
    names = [str(name) for name in fields.get("held/interfaces", [])]
    omega = np.asarray(fields.get("held/omega", []), dtype=np.float64).reshape(-1, 2)
    counts = np.asarray(fields.get("held/frequencies", []), dtype=np.int64)
    parts = np.split(omega, np.cumsum(counts)[:-1]) if len(counts) else []
    return {
        name: Held(part, float(error), str(port))
        for name, part, error, port in zip(
            names,
            parts,
            fields.get("held/compliance", []),
            fields.get("held/ports", []),
            strict=True,
        )
    }


@dataclass
class Claim:
    """The group ``/error`` of a reduced file, and what stands beside it. Errors are relative.

    Attributes
    ----------
    kind : str
        ``certified``: everywhere in ``bands``; ``certified outside``: but for the intervals
        ``excluded`` around undamped resonances; or ``estimated``.
    relative_to : str
        What errors are divided by at each frequency: ``pointwise`` ‖H‖ (eq. 17 of Fehr, Eberhard
        and Lehner); ``elastic`` ‖H‖ without rigid motion; ``both`` the smaller of these; ``band``
        the largest ‖H‖ of the band.
    bands, excluded : (k, 2) arrays
        [rad/s]
    supremum : float
        Largest error everywhere in the bands, of H and of each kind of ports (``pod``: the largest
        one known, at ``omega``).
    whole : float
        The same of H as a whole by itself.
    attained : float
        The bound at one frequency ``attained_at`` [rad/s]: the supremum is no less.
    omega, error, bound, floor : (k,) arrays
        A curve: frequencies [rad/s], the error there, its certified bound and the part of the bound
        that is rounding; bound and floor are empty for ``pod``.
    tolerance : float or None
        That was asked for; ``met`` tells whether the error of H and of each kind is within what was
        asked of it.
    unmet : (k, 2) array
        Intervals where the tolerance is not met [rad/s].
    kinds, by_kind : list of str, (k,) array
        Largest bounds of displacement from force, rotation from moment and so on; empty if the
        tolerance was for H as a whole, or none was given.
    kind_least : (k,) array
        Errors of each are relative to its ‖H‖, or to this where it is larger, in the unit of H.
    kind_tolerances : (k,) array
        What was asked of each, where kinds have tolerances of their own; else empty.
    unclaimed : list of str
        Kinds that nothing is claimed of by themselves (of assemblies). Where ``kinds`` names any,
        H is zero up to rounding for kinds in neither list.
    excluded_poles : (k, 3) array
        Undamped resonances in ``excluded``: frequency [rad/s], how far at most the body's is from
        it, relative, and how far its residue, relative. Empty with a damping matrix.
    rigid_rounding : float
        How much H would change, relative to ‖H‖, if the stiffness that K holds of the rigid modes,
        which is within its rounding and taken for zero, were meant. Not part of the error.
    data_rounding : array
        How much H may change at ``omega``, relative, by the digits with which the FE code wrote K:
        an estimate, of the matrices themselves and not of the reduction, so not part of the error.
        Zero if K was not printed. Empty for ``pod``.
    field_inputs, field_error : list of str, (k,) array
        Kinds of inputs, and for each the largest error of the whole field that they cause,
        relative, in the norm of the strain energy (``--field-error``); inf: not proved.
    held : dict of str to Held
        Of a free body with each interface held in turn, without damping: ``omega`` (k, 2), its
        frequencies in the bands [rad/s] and those of the medium model that it was cut from;
        ``compliance``, the largest relative error of what a load at a port moves that port by,
        statically, and that ``port``.
    loads : (n_in, k) array
        Loads P that the claim is for, each of unit norm: ‖Pᵀ(H − H_r)P‖ <= ε ‖PᵀHP‖ (where the
        outputs are not the inputs: (H − H_r)P); k = 0: each input by itself. ``load_names``.
    form : ErrorForm or None
        What is known of the error beyond its size.
    parameters, parameter_values : list of str, (k, d) array
        Parameters of the body, and the values with which the claim holds, a row each.
    attained_values : (d,) array
        Those of ``attained``.
    between_values : float or None
        Largest error of H as a whole that was seen with values between these, at frequencies; not
        proved. None: none were looked at.
    all_values : (1 + k,) array
        Largest error of H, and of each of ``kinds``, with every value of the parameters from their
        least to their most, everywhere in the bands. Empty: it is not proved.
    chosen, chosen_names : (d,) array or None, list of str
        The parameters' values that the body has been given (``ReducedModel.at``).
    """

    kind: str
    relative_to: str
    bands: Floats
    supremum: float
    whole: float
    attained: float
    attained_at: float
    omega: Floats
    error: Floats
    bound: Floats
    floor: Floats
    tolerance: float | None
    met: bool
    unmet: Floats
    kinds: list[str]
    by_kind: Floats
    kind_least: Floats
    kind_tolerances: Floats
    unclaimed: list[str]
    excluded: Floats
    excluded_poles: Floats
    rigid_rounding: float
    data_rounding: Floats
    field_inputs: list[str]
    field_error: Floats
    held: dict[str, Held]
    load_names: list[str]
    loads: Floats
    form: ErrorForm | None
    parameters: list[str] = field(default_factory=list)
    parameter_values: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    attained_values: Floats = field(default_factory=lambda: np.zeros(0))
    between_values: float | None = None
    all_values: Floats = field(default_factory=lambda: np.zeros(0))
    chosen: Floats | None = None
    chosen_names: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, fields: dict[str, Any], inputs: int) -> Claim:
        """From the fields of a reduced body."""

        def array(name: str) -> Floats:
            return np.asarray(fields.get(name, []), dtype=np.float64)

        def words(name: str) -> list[str]:
            return [str(word) for word in fields.get(name, [])]

        curve, bound, by_kind = (array(f"error/{x}") for x in ("relative", "bound", "by_kind"))
        known = float(np.concatenate([bound if len(bound) else curve, by_kind, [0]]).max())
        supremum = float(fields.get("error/worst", known))
        bands, load_names = array("error/bands").reshape(-1, 2), words("loads/names")
        return cls(
            kind=str(fields.get("error/kind", "estimated")),
            relative_to=str(fields.get("error/relative_to", "pointwise")),
            bands=bands if len(bands) else array("band").reshape(-1, 2),
            supremum=supremum,
            whole=float(fields.get("error/whole", supremum)),
            attained=float(fields.get("error/attained", known)),
            attained_at=float(fields.get("error/at", np.nan)),
            omega=array("error/omega"),
            error=curve,
            bound=bound,
            floor=array("error/floor"),
            tolerance=fields.get("error/tolerance"),
            met=bool(fields.get("error/met", True)),
            unmet=array("error/unmet").reshape(-1, 2),
            kinds=words("error/kinds"),
            by_kind=by_kind,
            kind_least=array("error/kind_least") if "error/kind_least" in fields else 0 * by_kind,
            kind_tolerances=array("error/kind_tolerances"),
            unclaimed=words("error/unclaimed"),
            excluded=array("error/excluded").reshape(-1, 2),
            excluded_poles=array("error/poles").reshape(-1, 3),
            rigid_rounding=float(fields.get("error/rigid_rounding", 0.0)),
            data_rounding=array("error/data_rounding"),
            field_inputs=words("error/field_inputs"),
            field_error=array("error/field"),
            held=held_of(fields),
            load_names=load_names,
            loads=array("loads/patterns").reshape(inputs, len(load_names)),
            form=ErrorForm.of(fields),
            parameters=words("error/parameter_values/names"),
            parameter_values=np.atleast_2d(array("error/parameter_values")),
            attained_values=array("error/at_values"),
            between_values=fields.get("error/between_values"),
            all_values=array("error/all_values"),
            chosen_names=words("error/chosen_names"),
            chosen=array("error/chosen") if "error/chosen" in fields else None,
        )

    def at(self, values: Mapping[str, float]) -> Self:
        """Of the body with these values of all its parameters: the claim for them, or that for all
        values, if there is one; else nothing that is proved, and the largest that was seen with
        values between."""
        names = self.parameters or list(values)
        chosen = np.array([values[name] for name in names])
        known = np.zeros(0, dtype=bool)
        if self.parameters:
            away = np.abs(self.parameter_values - chosen) > 1e-12 * np.abs(chosen)
            known = ~away.any(axis=1)
        at = replace(self, chosen=chosen, chosen_names=names, held={})
        if not (len(known) and known[0]):  # curves are of the first values
            none = np.zeros(0)
            unknown = np.full(len(self.error), np.nan)
            at = replace(at, error=unknown, bound=none, floor=none, data_rounding=none)
        if known.any():
            return at
        if len(self.all_values):
            worst, every = float(self.all_values.max()), self.all_values
            at = replace(at, supremum=worst, whole=float(every[0]), by_kind=every[1:])
            return replace(at, attained=np.nan, attained_at=np.nan)
        seen = max(self.supremum, self.between_values or 0.0)
        at = replace(at, supremum=seen, whole=max(self.whole, seen))
        return replace(at, kind="estimated", tolerance=None, met=True, unmet=np.zeros((0, 2)))

    @property
    def band(self) -> Floats:
        """First and last frequency of ``bands`` [rad/s], (2,)."""
        return np.array([self.bands[0, 0], self.bands[-1, 1]])

    @property
    def bounds_elastic_part(self) -> bool:
        """Whether the error is small beside ‖H‖ without rigid motion."""
        return self.relative_to in ("elastic", "both")

    @property
    def short_reference(self) -> str:
        """The same for an axis."""
        return {
            "pointwise": "‖H‖",
            "elastic": "‖H‖ without rigid motion",
            "both": "the smaller of ‖H‖ and its elastic part",
            "band": "the largest ‖H‖ of the band",
        }[self.relative_to]

    @property
    def plain_reference(self) -> str:
        """The same of responses, in a sentence: "… of their norm"."""
        return {
            "pointwise": "their norm",
            "elastic": "their norm without rigid motion",
            "both": "their norm, whether or not rigid motion counts",
            "band": "their largest norm in the band",
        }[self.relative_to]

    @property
    def words_of_reference(self) -> str:
        """What errors are relative to, in words."""
        whole = "the norm of H (eq. 17 of Fehr, Eberhard and Lehner)"
        elastic = "the norm of H without rigid motion"
        return {
            "pointwise": f"relative to {whole}",
            "elastic": f"relative to {elastic}",
            "both": f"relative to {whole} or to {elastic}, whichever is smaller",
            "band": "relative to the largest norm of H in the band",
        }[self.relative_to]

    @property
    def label(self) -> str:
        """What is claimed of the error, in words."""
        count = len(self.load_names)
        few = f", of the motion along {count} load{'s' if count != 1 else ''} in answer to them"
        return self._label_of_band() + self._words_of_values() + (few if count else "")

    def _words_of_values(self) -> str:
        several = ""
        if self.parameters:
            count, names = len(self.parameter_values), ", ".join(self.parameters)
            several = f"{count} value{'s' if count != 1 else ''} of {names}"
        if self.chosen is None:
            if len(self.all_values):
                every = f"; {self.all_values.max():.1e} with every value between"
                return f" with each of {several}{every}"
            return f" with each of {several}" if several else ""
        now = ", ".join(f"{n} = {x:g}" for n, x in zip(self.chosen_names, self.chosen, strict=True))
        but = several and self.kind == "estimated"
        return f" with {now}" + (f", but with {several}" if but else "")

    def _label_of_band(self) -> str:
        if self.kind != "certified outside":
            return "certified" if self.kind == "certified" else "estimated, not proved"
        widest = np.max(np.diff(self.excluded, axis=1)[:, 0] / self.excluded[:, 1])
        count = len(self.excluded)
        words = (
            f"certified outside {count} interval{'s' if count != 1 else ''} of relative width "
            f"{widest:.0e} at most, around undamped resonances"
        )
        if len(self.excluded_poles):
            _, frequency, residue = self.excluded_poles.max(axis=0)
            right = [
                f"{what} to {error:.0e}"
                for what, error in (("frequencies", frequency), ("heights (residues)", residue))
                if error < 1
            ]
            words += f", known by their {' and '.join(right)}" if right else ""
        return words

    @property
    def words(self) -> str:
        """The error and what it is worth."""
        if not np.isfinite(self.supremum):
            return "no bound of the error"
        return f"error {self.supremum:.1e} ({self.label})"

    @property
    def shortfall(self) -> str:
        """Which tolerance is not met, and where; empty if it is met."""
        if self.met or self.tolerance is None:
            return ""
        said = f"NOT within the tolerance {self.tolerance:g} that was asked for"
        hz = self.unmet / (2 * np.pi)
        bands = np.diff(self.bands / (2 * np.pi), axis=1).sum()
        if not len(hz) or np.diff(hz, axis=1).sum() > 0.999 * bands:
            return said
        widest = hz[np.argsort(hz[:, 0] - hz[:, 1], kind="stable")][:3]
        places = [
            f"from {a:.5g} to {b:.5g} Hz" if b - a > 0.1 * b else f"near {(a + b) / 2:.6g} Hz"
            for a, b in widest
        ]
        more = f" and in {len(hz) - 3} smaller intervals" if len(hz) > 3 else ""
        return f"{said}: {', '.join(places)}{more}; elsewhere it is"

    @property
    def words_of_data(self) -> str:
        """What the digits of K themselves may change; empty if K was not printed."""
        worst = float(self.data_rounding.max(initial=0))
        if not worst > 0:
            return ""
        return (
            f"the digits in which the FE code wrote K may change H by {worst:.1e} (an "
            "estimate, of the full body: not part of the error)"
        )

    @property
    def words_of_held(self) -> list[str]:
        """Frequencies and static compliance with each interface held, a line for each."""
        lines = []
        for name, held in self.held.items():
            hz = held.omega / (2 * np.pi)
            more = ", …" if len(hz) > 6 else ""
            said = "no frequency in the band"
            if len(hz):
                said = ", ".join(f"{full:.5g}" for _, full in hz[:6]) + f"{more} Hz "
                if held.frequency_error < 0.05:
                    said += f"(relative error {held.frequency_error:.1e})"
                else:
                    said += (
                        "of the body come out as "
                        + ", ".join(
                            f"{own:.5g}" if np.isfinite(own) else "none" for own, _ in hz[:6]
                        )
                        + more
                    )
            if np.isfinite(held.compliance):
                said += f", static compliance to {held.compliance:.1e} ({held.port})"
            lines.append(f"held at {name}: {said}")
        return lines

    def is_hidden(self, output: str, input_: str) -> bool:
        """Whether the claim of all of H is all that is known of a kind without a claim of its own;
        of others without one H is nothing but rounding."""
        return (output, input_) in CROSSED or f"{output} from {input_}" in self.unclaimed

    def __str__(self) -> str:
        return "\n".join(filter(None, [self.words, self.shortfall]))
