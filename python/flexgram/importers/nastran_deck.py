"""Bulk data of Nastran as pyNastran reads it: cards that are followed, grids, parameters."""

from __future__ import annotations

import contextlib
import io
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flexgram.basics import BodyError, errors_of
from flexgram.importers.nastran import reading

#: Element types that are shells, and ours.
SHELLS = {"CQUAD4": "quad", "CQUADR": "quad", "CTRIA3": "triangle", "CTRIAR": "triangle"}
BEAMS = ("CBAR", "CBEAM")
RODS = ("CROD", "CONROD", "CTUBE")
SPRINGS = ("CELAS1", "CELAS2", "CDAMP1", "CDAMP2", "CBUSH")
WEDGE = {"CPENTA6": "wedge"}
#: Beginnings of cards that say nothing of K and M of the unloaded body: of loads and cases, of
#: aeroelasticity, of optimisation, of heat, of what is asked for.
PASSED = (
    *("PLOTEL", "EIG", "SET1", "SET3", "ASET", "QSET", "BSET", "CSET", "USET", "SUPORT", "FREQ"),
    *("TSTEP", "TABLED", "TABDMP", "TABRND", "DAREA", "RLOAD", "TLOAD", "DLOAD", "LOAD", "LSEQ"),
    *("FORCE", "MOMENT", "PLOAD", "GRAV", "ACCEL", "TEMP", "RFORCE", "SPCD", "SPCR", "ENDDATA"),
    *("PARAM", "MDLPRM", "NLPARM", "NLPCI", "RANDPS", "RANDT", "DELAY", "DPHASE", "DTI", "SPOINT"),
    *("AERO", "AE", "CAERO", "PAERO", "SPLINE", "FLUTTER", "FLFACT", "MKAERO", "TRIM", "GUST"),
    *("MONPNT", "DIVERG", "CSSCHD", "DESVAR", "DVPREL", "DVMREL", "DVCREL", "DRESP", "DCONSTR"),
    *("DCONADD", "DSCREEN", "DVGRID", "DOPTPRM", "DEQATN", "DLINK", "DTABLE", "DMIJ", "DMIK"),
    *(
        "CBARAO",
        "MAT4",
        "MAT5",
        "CHBDY",
        "PHBDY",
        "CONV",
        "PCONV",
        "QBDY",
        "QHBDY",
        "QVOL",
        "RADBC",
    ),
)
#: Cards that are read here.
READ = {
    *("GRID", "GRDSET", "MAT1", "MAT8", "PSOLID", "PSHELL", "PCOMP", "PBAR", "PBARL", "PBEAM"),
    *(
        "PBEAML",
        "PROD",
        "PTUBE",
        "PELAS",
        "PBUSH",
        "CELAS1",
        "CELAS2",
        "CBUSH",
        "CONM2",
        "RBE2",
        "RBE3",
        "RBAR",
        "MPC",
        "MPCADD",
    ),
    *("CDAMP1", "CDAMP2", "PDAMP"),
    *("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S", "SPC", "SPC1", "SPCADD"),
    *("CTETRA", "CHEXA", "CPENTA", *SHELLS, *BEAMS, *RODS),
}


def read_bulk(path: Path) -> tuple[Any, dict[str, float]]:
    """pyNastran's model of a deck, with cross references. PARAM of its case control by their
    names."""
    with reading(path) as (model, folder):
        text = path.read_text(errors="replace")
        begins = re.search(r"^\s*BEGIN\b.*$", text, re.M | re.I)
        is_deck = begins and re.search(r"^\s*CEND\b", text, re.M | re.I)
        source = path
        if begins and not is_deck:  # bulk data behind BEGIN alone
            source = folder / path.name
            source.write_text(_with_whole_includes(text[begins.end() :], path.parent))
        model.read_bdf(str(source), punch=not is_deck, xref=False, validate=False)
        model.safe_cross_reference()
    return model, _parameters(path, text[: begins.start()] if begins and is_deck else "")


def _with_whole_includes(text: str, folder: Path) -> str:
    """Bulk data that is read elsewhere: its files to be included, with their folders."""
    pattern = r"^(\s*INCLUDE\s+)(['\"])(.+?)\2"
    return re.sub(pattern, lambda m: f"{m[1]}'{folder / m[3]}'", text, flags=re.M | re.I)


def _parameters(path: Path, control: str) -> dict[str, float]:
    """PARAM of case control that change K or M."""
    found: dict[str, float] = {}
    pattern = r"^\s*PARAM\s*[, ]\s*(WTMASS|G|COUPMASS)\s*[, ]\s*([^\s,$]*)"
    for name, word in re.findall(pattern, control, re.M | re.I):
        words = f"{path}: PARAM,{name.upper()} of case control"
        with errors_of(words):
            value = float(re.sub(r"(?<=[\d.])(?=[+-])", "e", word.lower().replace("d", "e")))
        if found.setdefault(name.upper(), value) != value:
            raise BodyError(f"{words} differs between cases")
    return found


@contextlib.contextmanager
def named(path: Path, what: str) -> Any:
    """pyNastran's errors, with what they are of."""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    except BodyError:
        raise
    except (Exception, SystemExit) as error:
        words = str(error).strip().splitlines()
        raise BodyError(
            f"{path}: {what} ({words[0] if words else type(error).__name__})"
        ) from error


class BulkDeck:
    """A model of pyNastran: its grids, and what is said of the reading."""

    def __init__(self, path: Path, ignore: set[str]) -> None:
        model, self.parameters = read_bulk(path.absolute())
        self.path, self.model, self.ignore = path, model, ignore
        self.remarks: list[str] = []
        self.labels = np.array(sorted(model.nodes), dtype=np.int64)
        if not len(self.labels):
            raise BodyError(f"{path}: no GRID: is this bulk data?")
        with named(path, "its grids cannot be placed"):
            self.points = np.array([model.nodes[int(n)].get_position() for n in self.labels])

    def expect_known(self) -> None:
        counts = Counter({str(k): int(v) for k, v in self.model.card_count.items()})
        if followed := sorted(self.ignore & READ):
            raise BodyError(f"{self.path}: --ignore {followed[0]}: it is followed")
        if self.model.superelement_models:
            raise BodyError(f"{self.path}: superelements (BEGIN SUPER) are not followed")
        defaults = self.model.grdset
        if defaults is not None and any((defaults.Cp(), defaults.Cd())):
            raise BodyError(f"{self.path}: GRDSET with CP or CD is not followed: write it in GRID")
        if names := sorted(self.cases() & {"K2GG", "M2GG", "B2GG", "K42GG", "K2PP", "M2PP"}):
            raise BodyError(f"{self.path}: {names[0]} of case control is not followed")
        unknown = {
            card: n
            for card, n in counts.items()
            if card not in READ | self.ignore and not card.startswith(PASSED)
        }
        if unknown:
            said = ", ".join(f"{card} ({n})" for card, n in sorted(unknown.items()))
            raise BodyError(
                f"{self.path}: {said}: not followed, and may say something of stiffness or mass; "
                "--ignore CARD passes over one"
            )
        if passed := sorted(self.ignore & set(counts)):
            self.remarks.append(f"passed over: {', '.join(f'{c} ({counts[c]})' for c in passed)}")
        of_loads = ("FORCE", "MOMENT", "PLOAD", "GRAV", "RFORCE", "TEMP")
        some = [f"{c} ({n})" for c, n in sorted(counts.items()) if c.startswith(of_loads)]
        if some:
            self.remarks.append(f"loads of the deck are left out: {', '.join(some)} (--load)")

    def remark(self, words: str) -> None:
        """Say it once."""
        if words not in self.remarks:
            self.remarks.append(words)

    def eta(self) -> float | None:
        """PARAM,G: a loss factor of all elements."""
        value = self.param("G")
        return value if value else None

    def cases(self) -> set[str]:
        """Names of what case control says."""
        control = self.model.case_control_deck
        if control is None:
            return set()
        return {str(key) for case in control.subcases.values() for key in case.params}

    def chosen(self, kind: str, numbers: Sequence[int]) -> list[int]:
        """The SPC or MPC of the first subcase; of bulk data alone, all of these numbers."""
        control = self.model.case_control_deck
        if control is None or not self.cases():
            known = sorted(set(numbers))
            if len(known) > 1:
                self.remarks.append(
                    f"no case control: {kind} {', '.join(map(str, known))} all count"
                )
            return known
        common = control.subcases[0].params.get(kind) if 0 in control.subcases else None
        found = [
            of.params.get(kind, common)
            for number, of in sorted(control.subcases.items())
            if number > 0
        ] or [common]
        chosen = [int(of[0]) for of in found if of is not None]
        if not chosen or found[0] is None:
            if numbers:
                free = ": the body is free" if kind == "SPC" else ""
                self.remarks.append(f"case control chooses no {kind}{free}")
            return []
        if len(set(chosen)) > 1:
            self.remarks.append(f"{kind} {chosen[0]} of the first subcase counts; others differ")
        return chosen[:1]

    def param(self, name: str) -> float | None:
        """A parameter; case control goes before bulk data."""
        if name in self.parameters:
            return self.parameters[name]
        param = self.model.params.get(name)
        return None if param is None else float(param.values[0])

    def refuse(self, card: str, number: int, why: str) -> BodyError:
        return BodyError(f"{self.path}: {card} {number}: {why}")

    def at(self, label: int) -> int:
        """Index of a grid."""
        k = int(np.searchsorted(self.labels, label))
        if k == len(self.labels) or self.labels[k] != label:
            raise BodyError(f"{self.path}: there is no grid {label}")
        return k

    def property_of(self, number: int, element: Any) -> Any:
        """That of an element, or the element that holds its numbers itself."""
        if element.type in ("CONROD", "CELAS2", "CDAMP2"):
            return element
        if element.pid_ref is None:
            raise self.refuse(element.type, number, "its property is missing")
        return element.pid_ref

    def expect_basic(self, card: str, number: int, nodes: Sequence[int]) -> None:
        for n in nodes:
            if self.model.nodes[n].Cd() != 0:
                raise self.refuse(card, number, f"grid {n} has axes of its own (CD)")
