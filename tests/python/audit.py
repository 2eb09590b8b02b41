"""Random systems against extended precision: does any true error exceed the certified one?

    audit.py [count] [seed] [csv] [--materials | --mixtures | --products | --spin | --speeds]
             [--prestressed] [--small] [--every N] [--from N]
        count systems, or every Nth of them, from the Nth on; a table by class and by damping

``--materials``: with loss factors by material instead of the seven other kinds of damping;
``--mixtures``: several of these at once; ``--products``: terms times a parameter;
``--spin``: with gyroscopic forces; ``--speeds``: with a range of speeds;
``--prestressed``: with the stiffness of a stress that presses or pulls; ``--small``: with a third
of the dofs, of which many are judged in a minute.

Each system is reduced in this process, with its tolerance and nothing else; the referee chooses
frequencies against the result (``referee.py``).
"""

from __future__ import annotations

import collections
import csv
import sys
import time
import warnings
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
from audit_cases import (
    CLASSES,
    DAMPINGS,
    MATERIALS,
    MIXTURES,
    PRESTRESSED,
    PRODUCTS,
    SPEEDS,
    SPIN,
    Case,
    random_case,
    what_of,
)

import flexgram
from flexgram.basics import BodyError
from referee import LONG, System, hard_frequencies, relative_error


@dataclass
class Verdict:
    """What became of a case."""

    outcome: str  # certified, certified outside, estimated, not met, refused
    ratio: float = 0.0  # largest true over certified error
    bound: float = 0.0
    sharp: float = 0.0  # certified over attained supremum
    at: float = 0.0
    field: float = 0.0  # largest true over certified error of the field
    words: str = ""
    order: int = 0
    true: float = 0.0  # largest true error
    floor: float = 0.0  # largest rounding part of the claim over the largest true error
    decides: bool = False  # that part is more than half of the claim


def reduced_system(rom: flexgram.ReducedModel) -> System:
    """The reduced body for the referee."""
    return System(
        *(rom.K, rom.M, rom.B, rom.C, rom.D),
        eta=rom.eta,
        rigid=int(rom.frame["rigid_modes"]),
        S=rom.system.S if rom.system.S.any() else None,
        terms=[
            (term.matrix, term.law.kind, *(list(x) for x in term.law.numbers().values()))
            for term in rom.system.terms
        ],
    )


def examine(case: Case, rng: np.random.Generator) -> Verdict:
    """Reduce, and let the referee look for an error above the certified one."""
    s = case.system
    matrices = flexgram.Matrices(
        K=sp.csr_matrix(s.K),
        M=sp.csr_matrix(s.M),
        D=None if s.D is None else sp.csr_matrix(s.D),
        S=None if s.S is None else sp.csr_matrix(s.S),
        B=s.B,
        C=None if s.C is s.B.T or np.array_equal(s.C, s.B.T) else s.C,
        alpha=s.alpha,
        beta=s.beta,
        eta=s.eta,
        terms={
            f"term{k}": (sp.csr_matrix(T), getattr(flexgram, law)(*numbers))
            for k, (T, law, *numbers) in enumerate(s.terms)
        }
        | {name: (sp.csr_matrix(T), law) for name, (T, law) in case.varying.items()},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            rom = flexgram.reduce(
                matrices,
                case.bands_hz,
                case.tolerance,
                options={"mor_field_error": "yes", **case.options},
            )
        except BodyError as error:
            return Verdict("refused", words=str(error))
    outcome = rom.kind if rom.met else "not met"
    verdict = Verdict(outcome, bound=rom.certified_error, order=rom.order)
    if rom.kind == "estimated":
        return verdict
    values = judged_values(case, rom, rng) if case.varying else [{}]
    worst, reference = 0.0, rom.relative_to if rom.bounds_elastic_part else "pointwise"
    for chosen in values:
        if chosen:
            s = case.at(chosen[case.name])
        here = rom.at(**chosen)
        reduced, bound = reduced_system(here), here.certified_error
        for omega in hard_frequencies(s, reduced, rom.bands, rom.excluded, rng):
            truth = relative_error(s, reduced, omega, reference)
            if truth > bound:  # by the rounding of long double?
                full = case.exactly_at(chosen[case.name]) if chosen else s
                truth = relative_error(full, reduced, omega, reference, exactly=True)
            if truth > worst:
                worst, verdict.at = truth, omega
            if np.isfinite(bound):  # else nothing is claimed
                verdict.ratio = max(verdict.ratio, truth / bound)
    verdict.true = worst
    if not rom.met and worst <= case.tolerance:
        verdict.true = max(worst, error_at_zeros(s, reduced, rom.unmet))
    if worst > 0:
        verdict.floor = rom.floor.max() / worst
        verdict.decides = bool(rom.floor.max() > 0.5 * verdict.bound)
    verdict.sharp = verdict.bound / rom.attained_error
    if np.isfinite(rom.field_error[0]):
        verdict.field = largest_field_error(s, rom, rng) / rom.field_error[0]
    return verdict


def judged_values(case: Case, rom: flexgram.ReducedModel, rng: np.random.Generator) -> Any:
    """Those that the claim is of; if it is of all, also where the error is largest as far as
    doubles show it, and a random one."""
    values = [float(p) for (p,) in rom.claim.parameter_values]
    if len(rom.claim.all_values):
        omega = np.concatenate([rng.uniform(first, last, 60) for first, last in rom.bands])
        law = next(iter(case.varying.values()))[1]
        tried = rng.uniform(law.least, law.most, 24)

        def largest(p: float) -> float:
            here = rom.at(**{case.name: p})
            H, H_r = (s.quickly(omega) for s in (case.at(p), reduced_system(here)))
            sizes = [np.linalg.norm(a, axis=(1, 2)) for a in (H - H_r, H)]
            return float((sizes[0] / sizes[1]).max())

        values += [tried[np.argmax([largest(p) for p in tried])], tried[0]]
    return [{case.name: float(p)} for p in values]


def error_at_zeros(s: System, reduced: System, intervals: Any) -> float:
    """The largest relative error at zeros of H on the axis, which lie between doubles: by the
    secant method from both ends of each interval, to forty digits."""
    worst = 0.0
    with mpmath.workdps(50):
        fewer = max(1, int(12 * min(1.0, (60 / len(s.M)) ** 3)))  # the price of an elimination
        for a, b in intervals[:fewer]:
            ends = [mpmath.mpf(float(a)), mpmath.mpf(float(b))]
            H = [complex(s.exactly(w)[0, 0]) for w in ends]
            for _ in range(12):
                if H[1] == H[0]:
                    break
                step = (ends[1] - ends[0]) * mpmath.mpmathify(H[1] / (H[1] - H[0]))
                ends = [ends[1], ends[1] - mpmath.re(step)]
                if not a <= ends[1] <= b:
                    break
                H = [H[1], complex(s.exactly(ends[1])[0, 0])]
                worst = max(worst, relative_error(s, reduced, ends[1], exactly=True))
    return worst


def largest_field_error(s: System, rom: flexgram.ReducedModel, rng: np.random.Generator) -> float:
    """Of the whole field, in the norm of the strain energy."""
    values, vectors = sl.eigh(np.asarray(s.K))
    strain = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T  # to find where to look
    rows = [
        System(s.K, s.M, s.B, strain, None, s.alpha, s.beta, s.eta),
        System(rom.K, rom.M, rom.B, strain @ rom.V, rom.D, eta=rom.eta),
    ]
    full = System(s.K, s.M, s.B, np.eye(len(s.K)), None, s.alpha, s.beta, s.eta)
    V, r = np.array(rom.V), int(rom.frame["rigid_modes"])
    V[:, :r] = V[:, :r].mean(axis=0)  # rigid modes count as exactly rigid
    reduced = System(rom.K, rom.M, rom.B, V, rom.D, eta=rom.eta)
    K = np.asarray(s.K).astype(LONG)

    def error(omega: float, exactly: bool) -> float:
        X, X_r = (a.exactly(omega) if exactly else a.transfer(omega) for a in (full, reduced))
        energy = [float(np.einsum("ij,ij->", x.conj(), K @ x).real) for x in (X - X_r, X)]
        return float(np.sqrt(max(energy[0], 0) / energy[1]))

    worst = 0.0
    for omega in hard_frequencies(*rows, rom.bands, rom.excluded, rng, 300):
        here = error(omega, exactly=False)
        if here > max(rom.field_error[0], worst):  # by the rounding of long double?
            here = error(omega, exactly=True)
        worst = max(worst, here)
    return worst


def main() -> int:
    """Print the table; exit status 1 if any error exceeds its certificate."""
    words = sys.argv[1:]
    steps = {"--every": 1, "--from": 0}
    for name in steps:
        if name in words:
            at = words.index(name)
            steps[name] = int(words[at + 1])
            del words[at : at + 2]
    words = [word for word in words if not word.startswith("--")]
    chosen = {
        "--materials": MATERIALS,
        "--mixtures": MIXTURES,
        "--prestressed": PRESTRESSED,
        "--products": PRODUCTS,
        "--spin": SPIN,
        "--speeds": SPEEDS,
    }
    dampings = next((of for word, of in chosen.items() if word in sys.argv), DAMPINGS)
    count = int(words[0]) if words else 200
    seed = int(words[1]) if len(words) > 1 else 1
    table: dict[Any, list[Verdict]] = collections.defaultdict(list)
    broken, start = 0, time.time()
    damped = missed = rightly = 0  # systems with damping, not met, whose true error is above
    chosen_ones = range(steps["--from"], count, steps["--every"])
    for index in chosen_ones:
        rng = np.random.default_rng([seed, index])
        kind, damping = what_of(index, dampings)
        case = random_case(rng, kind, damping, is_small="--small" in sys.argv)
        verdict = examine(case, rng)
        table[kind].append(verdict)
        table["damping: " + damping].append(verdict)
        if verdict.field > 1 + 1e-6:
            broken += 1
            print(
                f"BROKEN FIELD {index} {kind}, {damping}, tol {case.tolerance:.1e}: "
                f"true/certified {verdict.field:.3g}, m = {verdict.order}",
                flush=True,
            )
        if verdict.ratio > 1:
            broken += 1
            print(
                f"BROKEN {index} {kind}, {damping}, tol {case.tolerance:.1e}: true/certified "
                f"{verdict.ratio:.3g}, certified {verdict.bound:.2e}, at {verdict.at!r} rad/s "
                f"of {case.bands_hz}, m = {verdict.order}",
                flush=True,
            )
        damped += damping != "none"
        if verdict.outcome == "not met" and damping != "none":
            missed += 1
            rightly += verdict.true > case.tolerance
            print(
                f"not met {index} {kind}, {damping}, tol {case.tolerance:.1e}: certified "
                f"{verdict.bound:.2e}, true {verdict.true:.2e}, floor/true "
                f"{verdict.floor:.3g}, m = {verdict.order}",
                flush=True,
            )
        if index % 50 == 49:
            seen = [v for name, some in table.items() if name in CLASSES for v in some]
            print(
                f"{index + 1} of {count}, {time.time() - start:.0f} s: largest true/certified "
                f"{max(v.ratio for v in seen):.4f}, {broken} broken",
                flush=True,
            )
        if verdict.outcome == "refused":
            print(f"refused {index} {kind}, {damping}: {verdict.words}", flush=True)
    print(f"{len(chosen_ones)} systems, seed {seed}, {time.time() - start:.0f} s")
    print(
        f"{'class':22} {'systems':>8} {'certified':>10} {'outside':>8} {'estimated':>10} "
        f"{'not met':>8} {'refused':>8} {'true/bound':>17} {'bound/attained':>15} "
        f"{'field':>7}"
    )
    rows = [
        [
            "class",
            "systems",
            "certified",
            "outside intervals",
            "estimated",
            "not met",
            "refused",
            "largest true / certified",
            "certified / attained, median",
        ]
    ]
    for name, verdicts in table.items():
        number = lambda word: sum(v.outcome == word for v in verdicts)  # noqa: E731, B023
        ratios = [v.ratio for v in verdicts]
        sharp = [v.sharp for v in verdicts if 0 < v.sharp < np.inf]
        print(
            f"{name:22} {len(verdicts):8} {number('certified'):10} "
            f"{number('certified outside'):8} {number('estimated'):10} {number('not met'):8} "
            f"{number('refused'):8} {max(ratios):17.3f} "
            f"{np.median(sharp) if sharp else np.nan:15.3f} "
            f"{max(v.field for v in verdicts):7.3f}"
        )
        outcomes = ("certified", "certified outside", "estimated", "not met", "refused")
        median = np.median(sharp) if sharp else np.nan
        rows.append(
            [
                name,
                str(len(verdicts)),
                *(str(number(word)) for word in outcomes),
                f"{max(ratios):.3f}",
                f"{median:.2f}",
            ]
        )
    print(f"not met: {missed} of {damped} with damping, {rightly} of these rightly")
    deciding = [v.floor for verdicts in table.values() for v in verdicts if v.decides]
    if deciding:  # each is in two rows
        print(
            f"rounding is most of the claim of {len(deciding) // 2}: "
            f"{np.median(deciding):.3g} times the largest true error in the median"
        )
    if len(words) > 2:
        with open(words[2], "w", newline="") as file:
            csv.writer(file).writerows(rows)
    print(f"{broken} broken of {len(chosen_ones)}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
