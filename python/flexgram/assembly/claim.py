"""What the claims of parts say of their assembly, at frequencies and everywhere in the band."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from flexgram.assembly.band_bound import BandBound, merged
from flexgram.assembly.form_over_band import FormOverBand
from flexgram.assembly.gain_over_band import GainOverBand
from flexgram.assembly.joints import Joint, Parts, common_bands
from flexgram.assembly.small_gain import Loop
from flexgram.assembly.varying import with_values
from flexgram.basics import BodyError, Floats
from flexgram.model.reduced import ReducedBody

#: Intervals without a claim are beside resonances if none is wider than this, relative.
BESIDE = 0.01


def _are_narrow(intervals: Floats) -> bool:
    widths = 1 - intervals[:, 0] / np.maximum(intervals[:, 1], 1e-300)
    return bool(widths.max(initial=0) <= BESIDE)


@dataclass
class AssemblyBound:
    """What the parts' claims say of the assembly.

    Attributes
    ----------
    omega : (n,) array
        [rad/s]
    bound : (n,) array
        Of the assembly's error relative to ‖H‖_F of all ports; inf where it does not close.
    estimate : (n,) array
        The same error against the assembly of the parts' medium models; nan where a part does not
        keep the form of its error.
    gain : (n,) array
        Small gain: the bound closes below one; inf where nothing is known of a part.
    worst : float
        The bound everywhere in ``bands`` but ``open``; inf where frequencies were given.
    bands, open : (k, 2) arrays
        [rad/s]
    by_kind : dict of float
        The bound everywhere of each kind of outputs from each of inputs, relative to their block of
        H; inf: not known in all of that.
    sharp : bool
        There are resonances beside which nothing can be claimed.
    unknown : str
        Why the claims of the parts say nothing; empty: they do.
    most : str
        The part that most of the error is of, where it is largest by ``estimate``; empty: there is
        none, or it is not known.
    """

    omega: Floats
    bound: Floats
    gain: Floats
    estimate: Floats
    worst: float = np.inf
    bands: Floats = field(default_factory=lambda: np.empty((0, 2)))
    open: Floats = field(default_factory=lambda: np.empty((0, 2)))
    by_kind: dict[str, float] = field(default_factory=dict)
    sharp: bool = False
    unknown: str = ""
    most: str = ""

    @classmethod
    def with_each(cls, bounds: Sequence[Self]) -> Self:
        """What holds with each of several values; the curve is that of the first."""
        kinds = dict.fromkeys(kind for bound in bounds for kind in bound.by_kind)
        return replace(
            bounds[0],
            worst=max(bound.worst for bound in bounds),
            open=merged([(a, b) for bound in bounds for a, b in bound.open]),
            sharp=any(bound.sharp for bound in bounds),
            by_kind={
                kind: max(bound.by_kind.get(kind, np.inf) for bound in bounds) for kind in kinds
            },
            unknown=next((bound.unknown for bound in bounds if bound.unknown), ""),
        )

    @property
    def kind(self) -> str:
        """As of a reduced body: ``certified``, ``certified outside``, ``estimated``."""
        if self.unknown or not np.isfinite(self.worst):
            return "estimated"
        if not len(self.open):
            return "certified"
        return "certified outside" if self.sharp and _are_narrow(self.open) else "estimated"

    @property
    def words(self) -> str:
        if self.unknown:
            return f"not known: {self.unknown}"
        known = {kind: worst for kind, worst in self.by_kind.items() if worst < np.inf}
        unknown = [kind for kind, worst in self.by_kind.items() if worst == np.inf]
        parts = [f"of {kind} {worst:.1e}" for kind, worst in known.items()]
        by_kind = f"; {', '.join([f'of H as a whole {self.worst:.1e}', *parts])}" if known else ""
        by_kind += f"; nothing by itself of {', '.join(unknown)}" if unknown else ""
        seen = self.estimate[np.isfinite(self.estimate)]
        of_part = f", most of it from part {self.most}" if self.most else ""
        about = f"; of H about {seen.max():.1e}, by estimate{of_part}" if len(seen) else ""
        largest = max([self.worst, *known.values()])
        if self.kind == "certified":
            return (
                f"at most {largest:.1e} at each frequency, everywhere in the band, certified by "
                f"the parts' claims{by_kind}{about}"
            )
        if self.kind == "certified outside":
            return (
                f"at most {largest:.1e} at each frequency of the band but in {len(self.open)} "
                "intervals beside undamped resonances, certified by the parts' claims"
                f"{by_kind}{about}"
            )
        wide = np.diff(self.bands, axis=1).sum()
        share = 1 - np.diff(self.open, axis=1).sum() / wide if wide > 0 else 0.0
        by = f" (by {self.worst:.1e})" if np.isfinite(self.worst) else ""
        top = self.gain[np.isfinite(self.gain)].max(initial=0)
        why = "H is small beside the parts' errors or the rounding of the stiffest spring"
        if top > 0.5:
            why = (
                f"their errors may grow in the assembly (gain up to {top:.1g}): reduce the "
                "parts to a smaller tolerance"
            )
        return (
            f"the parts' claims bound it in {100 * share:.3g} % of the band{by}; elsewhere "
            f"{why}{about}"
        )


#: Its name in 0.1.
Verdict = AssemblyBound


def verdict(
    models: Mapping[str, ReducedBody],
    joints: Sequence[Joint],
    *,
    turns: Mapping[str, ArrayLike] | None = None,
    keep: Sequence[str] = (),
    omega: ArrayLike | None = None,
    modes: Floats | None = None,
    curve: bool = True,
    tell: Callable[[str], None] | None = None,
) -> AssemblyBound:
    """What the parts' claims say of the assembly's H: at frequencies, or in the whole band.

    Parameters
    ----------
    models, joints, turns, keep
        As of ``couple``; parameters have their present values.
    omega : (n,) array, optional
        [rad/s]; default: everywhere in the band that the parts share, shown at the frequencies of
        their curves and the assembly's ``modes`` there.
    curve : bool
        False leaves the bounds at these frequencies out: the largest everywhere is all.
    tell : callable, optional
        Called every few seconds with how far it is.

    Raises
    ------
    BodyError
        For frequencies outside a part's band.

    Examples
    --------
    >>> from flexgram.assembly.joints import Joint
    >>> rack = flexgram.ReducedModel.load("rack.rom.h5")
    >>> said = verdict({"a": rack, "b": rack}, [Joint("a.upper", "b.lower")], omega=[300.0])
    >>> bool(said.bound[0] < 0.1)
    True
    """
    models, joints = with_values(models, joints, {})
    parts = Parts(models, turns or {}, joints, internal_variables=True)
    models = parts.models
    bands = common_bands([m.claim.bands for m in models.values()])
    if omega is None:
        grid = np.concatenate(
            [*(m.claim.omega for m in models.values()), np.empty(0) if modes is None else modes]
        )
        w = np.unique(grid)
        w = w[np.any([(w >= a) & (w <= b) for a, b in bands], axis=0)]
        w = np.unique(np.concatenate([w[:: max(1, len(w) // 400)], bands.ravel()]))
    else:
        w = np.atleast_1d(np.asarray(omega, dtype=float))
        if not np.all(
            np.any([(w >= a * (1 - 1e-12)) & (w <= b * (1 + 1e-12)) for a, b in bands], axis=0)
        ):
            raise BodyError("a frequency is outside the band that the parts share")
    loop = Loop(parts, joints, keep)
    unknown = np.full(len(w), np.inf)
    found = AssemblyBound(w, unknown, unknown.copy(), np.full(len(w), np.nan), bands=bands)
    reasons = [why for name, model in models.items() if (why := _silent(name, model))]
    found.unknown = "; ".join(reasons)
    if found.unknown:
        return found
    forms = [m.claim.form for m in models.values() if m.claim.form is not None]
    by_form = FormOverBand(loop, forms, tell) if len(forms) == len(models) else None
    told = np.flatnonzero(np.full(len(w), curve))
    for a, b in np.concatenate([m.claim.excluded for m in models.values()]):
        told = told[(w[told] < a) | (w[told] > b)]
    if by_form is not None:
        bounds, estimates, found.gain[told] = by_form.at(w[told])
        found.bound[told], found.estimate[told] = bounds[:, 0], estimates[:, 0]
        found.most = _part_of_most(found, by_form, list(models))
    else:
        for k in told:
            bounds, found.gain[k] = loop.at(w[k])
            found.bound[k] = bounds[0]
    if omega is None:
        over_band: BandBound = by_form or GainOverBand(loop, tell)
        proof = over_band.prove(bands)
        found.worst, found.open, found.sharp = proof.worst, proof.open, proof.sharp
        if found.kind != "estimated":
            for k, view in enumerate(loop.views[1:], 1):
                mine = over_band.prove(bands, k)
                both = merged([*map(tuple, found.open), *map(tuple, mine.open)])
                same = len(both) == len(found.open) and _are_narrow(both)  # the same resonances
                found.by_kind[view.name] = mine.worst if same else np.inf
                found.open = both if same else found.open
    return found


def _part_of_most(found: AssemblyBound, by_form: FormOverBand, names: list[str]) -> str:
    """The part whose error is more than twice that of any other; empty: there is none."""
    known = np.flatnonzero(np.isfinite(found.estimate))
    if not len(known) or len(names) < 2:
        return ""
    shares = by_form.shares(float(found.omega[known[np.argmax(found.estimate[known])]]))
    order = np.argsort(shares)
    return names[order[-1]] if shares[order[-1]] > 2 * shares[order[-2]] else ""


def _silent(name: str, model: ReducedBody) -> str:
    """Why the claim of a part says nothing of its H at a frequency; empty: it does."""
    if model.claim.form is not None:
        return ""
    if model.claim.kind == "estimated":
        return f"part {name} is not certified"
    if model.claim.relative_to == "band":
        return (
            f"the claim of part {name} is relative to the largest H of the band and says too "
            "little of each frequency (--tol-relative-to both)"
        )
    if model.claim.load_names:
        return f"part {name} was reduced for few loads, of single ports nothing is claimed"
    return ""
