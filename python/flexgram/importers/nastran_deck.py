"""Bulk data of Nastran as pyNastran reads it: cards that are followed, grids, parameters."""

from __future__ import annotations

import contextlib
import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flexgram.basics import BodyError, Floats, errors_of
from flexgram.importers.nastran import reading

#: Element types that are shells, and ours.
SHELLS = {
    "CQUAD4": "quad",
    "CQUADR": "quad",
    "CTRIA3": "triangle",
    "CTRIAR": "triangle",
    "CQUAD8": "quad8",
    "CTRIA6": "triangle6",
}
BEAMS = ("CBAR", "CBEAM")
RODS = ("CROD", "CONROD", "CTUBE")
SPRINGS = (
    *("CELAS1", "CELAS2", "CELAS3", "CELAS4", "CDAMP1", "CDAMP2", "CDAMP3", "CDAMP4"),
    "CBUSH",
)
WEDGE = {"CPENTA6": "wedge"}
#: Beginnings of cards that say nothing of K and M of the unloaded body: of loads and cases, of
#: aeroelasticity, of optimisation, of heat, of nonlinear steps, of what is asked for.
PASSED = (
    *("PLOTEL", "EIG", "SET1", "SET3", "ASET", "QSET", "BSET", "CSET", "USET", "SUPORT", "FREQ"),
    *("TSTEP", "TABLED", "TABDMP", "TABRND", "DAREA", "RLOAD", "TLOAD", "DLOAD", "LOAD", "LSEQ"),
    *("FORCE", "MOMENT", "PLOAD", "GRAV", "ACCEL", "TEMP", "RFORCE", "SPCD", "SPCR", "ENDDATA"),
    "SLOAD",
    *(
        "MATS1",
        "TABLES1",
        "NLSTEP",
        "NLCNTL",
        "PARAM",
        "MDLPRM",
        "NLPARM",
        "NLPCI",
        "RANDPS",
        "RANDT",
        "DELAY",
        "DPHASE",
        "DTI",
    ),
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
#: Cards that change a material by its temperature, if case control gives one.
BY_TEMPERATURE = ("MATT1", "MATT2", "MATT8", "MATT9", "TABLEM")
#: Cards that are read here.
READ = {
    *(
        "GRID",
        "GRDSET",
        "MAT1",
        "MAT2",
        "MAT8",
        "MAT9",
        "PSOLID",
        "PSHELL",
        "PCOMP",
        "PCOMPG",
        "PBAR",
        "PBARL",
        "PBEAM",
    ),
    *(
        "PBEAML",
        "PROD",
        "PTUBE",
        "PELAS",
        "PBUSH",
        "CSHEAR",
        "PSHEAR",
        "CFAST",
        "PFAST",
        "CWELD",
        "PWELD",
        "CONM1",
        "CONM2",
        "CMASS1",
        "CMASS2",
        "CMASS3",
        "CMASS4",
        "PMASS",
        "RBE2",
        "RBE3",
        "RBAR",
        "MPC",
        "MPCADD",
    ),
    *("PDAMP", "DMI", "SPOINT", "BAROR", "BEAMOR"),
    *("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S", "SPC", "SPC1", "SPCADD"),
    *("CTETRA", "CHEXA", "CPENTA", "CPYRAM", *SHELLS, *BEAMS, *RODS, *SPRINGS),
}


def read_bulk(path: Path) -> tuple[Any, dict[str, float], list[str]]:
    """pyNastran's model of a deck, with cross references. PARAM of its case control by their names;
    files that its executive control includes, which are not read."""
    with reading(path) as (model, folder):
        text = path.read_text(errors="replace")
        begins = re.search(r"^\s*BEGIN\b.*$", text, re.M | re.I)
        cend = re.search(r"^\s*CEND\b", text, re.M | re.I)
        is_deck = begins is not None and cend is not None
        executive = text[: cend.start()] if begins and cend else ""
        source, alters = path, INCLUDE.findall(executive)
        if alters:
            source = folder / path.name
            rest = _with_whole_includes(text[len(executive) :], path.parent)
            source.write_text(INCLUDE.sub("$", executive) + rest)
        elif begins and not is_deck:  # bulk data behind BEGIN alone
            source = folder / path.name
            source.write_text(_with_whole_includes(text[begins.end() :], path.parent))
        grids = _systems_of_grids(model) if re.search("GRDSET", text, re.I) else {}
        model.read_bdf(str(source), punch=not is_deck, xref=False, validate=False)
        _set_systems(path, model, grids)
        model.safe_cross_reference()
    control = text[: begins.start()] if begins and is_deck else ""
    return model, _parameters(path, control), [name.strip("'\"") for name in alters]


def _systems_of_grids(model: Any) -> dict[int, tuple[bool, bool]]:
    """Whether each GRID that will be read says its CP and its CD, which pyNastran does not keep."""
    from pyNastran.bdf.bdf_interface.utils import to_fields

    said: dict[int, tuple[bool, bool]] = {}
    add_card = model.add_card

    def add(lines: Any, name: str, *further: Any, **options: Any) -> Any:
        if name.upper() == "GRID":
            given = options.get("is_list", False)
            fields = lines if given else to_fields(lines, name)
            words = [str(word or "").strip() for word in [*fields, *8 * [""]][:8]]
            said[int(words[1])] = (bool(words[2]), bool(words[6]))
        return add_card(lines, name, *further, **options)

    model.add_card = add
    return said


def _set_systems(path: Path, model: Any, said: dict[int, tuple[bool, bool]]) -> None:
    """CP and CD of GRDSET, of grids that do not say theirs."""
    defaults = model.grdset
    if defaults is None or not (defaults.cp or defaults.cd):
        return
    for label, node in model.nodes.items():
        if label not in said:
            raise BodyError(
                f"{path}: GRDSET of an included file has CP or CD: write it in this one, or in GRID"
            )
        says_cp, says_cd = said[label]
        if defaults.cp and not says_cp:
            node.cp = defaults.cp
        if defaults.cd and not says_cd:
            node.cd = defaults.cd
    defaults.cp = defaults.cd = 0  # else pyNastran takes a 0 of a grid for a blank


def _heat_of_elements(paths: Iterable[Path]) -> list[tuple[str, int]]:
    """Cards of temperatures of elements and their sets, of a deck and what it includes."""
    card = re.compile(r"^(TEMP(?:P1|P3|RB|B3|N1))\*?[ ,]+(\d+)", re.M | re.I)
    texts = (path.read_text(errors="replace") for path in paths)
    return [(kind.upper(), int(n)) for text in texts for kind, n in card.findall(text)]


#: Of a file; its name, in quotes or not.
INCLUDE = re.compile(r"^\s*INCLUDE\s+('[^']*'|\"[^\"]*\"|\S+)", re.M | re.I)


def _with_whole_includes(text: str, folder: Path) -> str:
    """Bulk data that is read elsewhere: its files to be included, with their folders."""
    pattern = r"^(\s*INCLUDE\s+)(?:(['\"])(.+?)\2|([^\s'\"$]+))"
    return re.sub(pattern, lambda m: f"{m[1]}'{folder / (m[3] or m[4])}'", text, flags=re.M | re.I)


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


class LeftOut(Exception):
    """A load set that is left out, and why."""


class BulkDeck:
    """A model of pyNastran: its grids, and what is said of the reading."""

    def __init__(self, path: Path, ignore: set[str]) -> None:
        model, self.parameters, alters = read_bulk(path.absolute())
        self.path, self.model, self.ignore = path, model, ignore
        self.remarks: list[str] = []
        #: Temperatures of elements, which pyNastran keeps no more than their number: kind and set.
        self.heat_of_elements = _heat_of_elements(
            [path.absolute(), *map(Path, model.active_filenames[1:])]
        )
        if alters:
            self.remarks.append(
                f"files of executive control are not read: {', '.join(alters)}; what they alter is "
                "not supported"
            )
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
            raise BodyError(f"{self.path}: superelements (BEGIN SUPER) are not supported")
        if names := sorted(self.cases() & {"K2GG", "M2GG", "B2GG", "K42GG", "K2PP", "M2PP"}):
            raise BodyError(f"{self.path}: {names[0]} of case control is not supported")
        unknown = {
            card: n
            for card, n in counts.items()
            if card not in READ | self.ignore and not card.startswith(PASSED)
        }
        if not any(case.startswith("TEMP") for case in self.cases()):
            cards = [card for card in unknown if card.startswith(BY_TEMPERATURE)]
            for card in cards:
                del unknown[card]
            if cards:
                self.remarks.append(
                    f"{', '.join(cards)}: case control chooses no temperature, so materials are "
                    "those without them"
                )
        if unknown:
            said = ", ".join(f"{card} ({n})" for card, n in sorted(unknown.items()))
            raise BodyError(
                f"{self.path}: {said}: not supported, and may say something of stiffness or mass; "
                "--ignore CARD passes over one"
            )
        known = {str(card) for card in self.model.cards_to_read} | READ
        if strange := {
            c: n
            for c, n in sorted(counts.items())
            if c not in known | self.ignore and c[:4] != "TEMP"
        }:
            said = ", ".join(f"{card} ({n})" for card, n in strange.items())
            self.remarks.append(f"cards that pyNastran does not know are passed over: {said}")
        if passed := sorted(self.ignore & set(counts)):
            self.remarks.append(f"passed over: {', '.join(f'{c} ({counts[c]})' for c in passed)}")
        if "SDAMPING" in self.cases():
            self.remarks.append(
                "SDAMPING of case control, damping by modes (TABDMP1), is left out (--zeta, or "
                "--eta)"
            )

    def rejected(self, card: str) -> list[list[str]]:
        """Fields of cards that pyNastran does not know, blank ones empty."""
        from pyNastran.bdf.bdf_interface.utils import to_fields

        found = []
        for _, *lines in self.model.reject_lines:  # a comment comes first
            if lines and lines[0].split(",")[0].split()[0].upper().rstrip("*") == card:
                with named(self.path, f"{card} is not understood"):
                    fields = to_fields(lines, card)
                    found.append([str(f or "").strip() for f in [*fields, *16 * [""]]])
        return found

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
                others = f"; another one chooses {kind} {chosen[0]}" if chosen else ""
                which = "the first subcase" if chosen else "case control"
                self.remarks.append(f"{which} chooses no {kind}{free}{others}")
            return []
        if chosen[0] not in numbers:
            free = ", the body is free" if kind == "SPC" else ""
            self.remarks.append(
                f"case control chooses {kind} {chosen[0]}, which is not in the deck: none "
                f"counts{free}"
            )
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

    def axes(self, label: int) -> Floats:
        """Those of its displacements (CD), in rows."""
        system = self.model.nodes[label].cd_ref
        if system is None or self.model.nodes[label].Cd() == 0:
            return np.eye(3)
        return self.axes_at(system, self.points[self.at(label)])

    def axes_at(self, system: Any, point: Floats) -> Floats:
        """Those of a coordinate system at a point, in rows: of cylindrical and spherical ones they
        turn."""
        axes: Floats = np.array(system.beta(), dtype=float)
        x, y, z = axes @ (point - system.origin)
        if system.type[-1] == "R":
            return axes
        theta = np.arctan2(y, x)
        outward = np.array([np.cos(theta), np.sin(theta), 0.0])
        around = np.array([-np.sin(theta), np.cos(theta), 0.0])
        if system.type[-1] == "C":
            own = np.array([outward, around, [0.0, 0.0, 1.0]])
        else:
            phi = np.arctan2(np.hypot(x, y), z)
            up = np.array([0.0, 0.0, 1.0])
            own = np.array(
                [
                    np.sin(phi) * outward + np.cos(phi) * up,
                    np.cos(phi) * outward - np.sin(phi) * up,
                    around,
                ]
            )
        turned: Floats = own @ axes
        return turned

    def property_of(self, number: int, element: Any) -> Any:
        """That of an element, or the element that holds its numbers itself."""
        if element.type in ("CONROD", "CELAS2", "CELAS4", "CDAMP2", "CDAMP4"):
            return element
        if element.pid_ref is None:
            raise self.refuse(element.type, number, "its property is missing")
        return element.pid_ref

    def common_axes(self, card: str, number: int, nodes: Sequence[int]) -> Floats:
        """Those of the displacements of grids, in rows, which are the same of all."""
        axes = [self.axes(n) for n in nodes]
        if any(np.abs(other - axes[0]).max() > 1e-9 for other in axes[1:]):
            raise self.refuse(card, number, "its grids have different axes (CD)")
        return axes[0]
