"""Nastran bulk data assembled by flexgram, read by pyNastran.

Solids, shells and straight beams become elements, CONM2 masses, CELAS, CDAMP and CBUSH springs,
CROD rods, RBE2 rigid and RBE3 distributing interfaces, SPC
supports. Cards that say something else of stiffness or mass are refused by name, with their count,
unless they are to be ignored; loads are left out and named.
"""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
import warnings
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.description import import_description
from flexgram.body.meshfile import LABELS
from flexgram.importers.fe import Interface, check_damping
from flexgram.importers.mesh import describe_interfaces, further_keys
from flexgram.importers.nastran import REORDER, SOLIDS
from flexgram.importers.nastran_sections import beam_section

#: Element types that are shells, and ours.
SHELLS = {"CQUAD4": "quad", "CQUADR": "quad", "CTRIA3": "triangle", "CTRIAR": "triangle"}
BEAMS = ("CBAR", "CBEAM")
RODS = ("CROD", "CONROD")
SPRINGS = ("CELAS1", "CELAS2", "CDAMP1", "CDAMP2", "CBUSH")
WEDGE = {"CPENTA6": "wedge"}
#: Beginnings of cards that say nothing of K and M of the unloaded body: of loads and cases, of
#: aeroelasticity, of optimisation, of what is asked for.
PASSED = (
    *("PLOTEL", "EIG", "SET1", "SET3", "ASET", "QSET", "BSET", "CSET", "USET", "SUPORT", "FREQ"),
    *("TSTEP", "TABLED", "TABDMP", "TABRND", "DAREA", "RLOAD", "TLOAD", "DLOAD", "LOAD", "LSEQ"),
    *("FORCE", "MOMENT", "PLOAD", "GRAV", "ACCEL", "TEMP", "RFORCE", "SPCD", "SPCR", "ENDDATA"),
    *("PARAM", "MDLPRM", "NLPARM", "NLPCI", "RANDPS", "RANDT", "DELAY", "DPHASE", "DTI", "SPOINT"),
    *("AERO", "AE", "CAERO", "PAERO", "SPLINE", "FLUTTER", "FLFACT", "MKAERO", "TRIM", "GUST"),
    *("MONPNT", "DIVERG", "CSSCHD", "DESVAR", "DVPREL", "DVMREL", "DVCREL", "DRESP", "DCONSTR"),
    *("DCONADD", "DSCREEN", "DVGRID", "DOPTPRM", "DEQATN", "DLINK", "DTABLE", "DMIJ", "DMIK"),
)
#: Cards that are read here.
READ = {
    *("GRID", "GRDSET", "MAT1", "MAT8", "PSOLID", "PSHELL", "PCOMP", "PBAR", "PBARL", "PBEAM"),
    *("PBEAML", "PROD", "PELAS", "PBUSH", "CELAS1", "CELAS2", "CBUSH", "CONM2", "RBE2", "RBE3"),
    *("CDAMP1", "CDAMP2", "PDAMP"),
    *("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S", "SPC", "SPC1", "SPCADD"),
    *("CTETRA", "CHEXA", "CPENTA", *SHELLS, *BEAMS, *RODS),
}


def read_bulk(path: Path) -> Any:
    """pyNastran's model of a deck, with cross references; its many errors as one."""
    try:
        from pyNastran.bdf.bdf import BDF
    except ImportError:
        raise BodyError("Nastran files are read by pyNastran: pip install pyNastran") from None
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    model = BDF(debug=None)
    text = path.read_text(errors="replace")
    begins = re.search(r"^\s*BEGIN\b.*$", text, re.M | re.I)
    is_deck = begins and re.search(r"^\s*CEND\b", text, re.M | re.I)
    try:
        with (
            contextlib.redirect_stdout(io.StringIO()),
            warnings.catch_warnings(),
            tempfile.TemporaryDirectory() as folder,
        ):
            warnings.simplefilter("ignore")
            _expect_no_parameters(path, text[: begins.start()] if begins and is_deck else "")
            source = path
            if begins and not is_deck:  # bulk data behind BEGIN alone
                source = Path(folder) / path.name
                source.write_text(text[begins.end() :])
            model.read_bdf(str(source), punch=not is_deck, xref=False, validate=False)
            model.safe_cross_reference()
    except BodyError:
        raise
    except (Exception, SystemExit) as error:
        reason = " ".join(str(error).split())[:300]
        raise BodyError(
            f"{path}: pyNastran cannot read it ({reason or type(error).__name__})"
        ) from error
    return model


def _expect_no_parameters(path: Path, control: str) -> None:
    """PARAM that change K or M stand in the bulk data."""
    found = re.search(r"^\s*PARAM\s*[, ]\s*(WTMASS|G|COUPMASS)\b", control, re.M | re.I)
    if found:
        raise BodyError(f"{path}: PARAM,{found[1].upper()} in case control: put it into bulk data")


def assemble_bulk(
    path: Path,
    output: str | Path,
    interfaces: Sequence[Interface],
    *,
    units: str = "SI",
    alpha: float | None = None,
    beta: float | None = None,
    eta: float | None = None,
    loads: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    merge: float | None = None,
    keep_repeated: bool = False,
    spin: Mapping[str, Any] | None = None,
    preload: Mapping[str, float] | None = None,
    ignore: Collection[str] = (),
) -> dict[str, Any]:
    """Write a mesh body of bulk data.

    Parameters
    ----------
    path : Path
        ``.bdf``, ``.nas``, ``.dat``: a deck, or its bulk data alone.
    output : str or Path
        Body file to write.
    interfaces : sequence of Interface
        Beside those of RBE2 and RBE3; node numbers are those of grids.
    units : str
        Of the deck: ``SI``, ``mm-t-s`` or ``mm-kg-s``.
    ignore : collection of str
        Cards to pass over though they say something of stiffness or mass.

    Other parameters are those of ``import_mesh``.

    Returns
    -------
    dict
        As ``import_body``, with ``remarks``.

    Raises
    ------
    BodyError
        For a deck that says more of K or M than is followed here.
    """
    check_damping(alpha, beta, eta)
    bulk = _Bulk(path, read_bulk(path), {card.upper() for card in ignore})
    content = bulk.describe()
    named = describe_interfaces(interfaces)
    for entry in (*named.values(), *(loads or {}).values(), *(outputs or {}).values()):
        bulk.number(entry)
    for name in named:
        if name in content["interfaces"]:
            raise BodyError(f"interface {name} is given twice: it is one of the deck's")
    content["interfaces"] |= named
    if not content["interfaces"]:
        raise BodyError(f"{path}: name an interface (--rigid, --node): it has no RBE2 or RBE3")
    content |= {
        "name": path.stem,
        "units": units,
        "loads": {name: dict(entry) for name, entry in (loads or {}).items()},
        "outputs": {name: dict(entry) for name, entry in (outputs or {}).items()},
        "damping": {
            key: value
            for key, value in (
                ("alpha", alpha),
                ("beta", beta),
                ("eta", bulk.eta() if eta is None else eta),
            )
            if value is not None
        },
    }
    content |= further_keys(merge, keep_repeated, spin, preload)
    counts = import_description(content, str(path), output, inputs=[path], mesh=bulk.mesh())
    return {**counts, "remarks": bulk.remarks}


class _Bulk:
    """A model of pyNastran as a description."""

    def __init__(self, path: Path, model: Any, ignore: set[str]) -> None:
        self.path, self.model, self.ignore = path, model, ignore
        self.remarks: list[str] = []
        self.told_shear = False
        self.labels = np.array(sorted(model.nodes), dtype=np.int64)
        if not len(self.labels):
            raise BodyError(f"{path}: no GRID: is this bulk data?")
        with _named(path, "its grids cannot be placed"):
            self.points = np.array([model.nodes[int(n)].get_position() for n in self.labels])
        self.materials: dict[str, dict[str, Any]] = {}
        self.sections: dict[str, dict[str, Any]] = {}
        self.regions: dict[str, dict[str, Any]] = {}
        self.groups: dict[tuple[str, str], tuple[list[list[int]], list[int]]] = {}
        self.masses: dict[str, dict[str, Any]] = {}
        self.springs: dict[str, dict[str, Any]] = {}
        self.supports: dict[str, dict[str, Any]] = {}
        self.interfaces: dict[str, dict[str, Any]] = {}
        self.later: list[tuple[int, Any]] = []
        self.references: dict[int, str] = {}  # of RBE2, where nothing else is
        self.used: set[int] = set()
        self.grounded: set[int] = set()  # grids of RBE2 that are held
        self.shared: dict[int, tuple[str, list[int]]] = {}  # of RBE2 by their reference
        self.turning: set[int] = set()

    # What is there

    def _expect_known(self) -> None:
        counts = Counter({str(k): int(v) for k, v in self.model.card_count.items()})
        if followed := sorted(self.ignore & READ):
            raise BodyError(f"{self.path}: --ignore {followed[0]}: it is followed")
        if self.model.superelement_models:
            raise BodyError(f"{self.path}: superelements (BEGIN SUPER) are not followed")
        defaults = self.model.grdset
        if defaults is not None and any((defaults.Cp(), defaults.Cd(), defaults.Ps())):
            raise BodyError(
                f"{self.path}: GRDSET with CP, CD or PS is not followed: write it in GRID"
            )
        if names := sorted(self._cases() & {"K2GG", "M2GG", "B2GG", "K42GG", "K2PP", "M2PP"}):
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

    def eta(self) -> float | None:
        """PARAM,G: a loss factor of all elements."""
        value = self._param("G")
        return value if value else None

    def _cases(self) -> set[str]:
        """Names of what case control says."""
        control = self.model.case_control_deck
        if control is None:
            return set()
        return {str(key) for case in control.subcases.values() for key in case.params}

    def _param(self, name: str) -> float | None:
        param = self.model.params.get(name)
        return None if param is None else float(param.values[0])

    def _refuse(self, card: str, number: int, why: str) -> BodyError:
        return BodyError(f"{self.path}: {card} {number}: {why}")

    def at(self, label: int) -> int:
        """Index of a grid."""
        k = int(np.searchsorted(self.labels, label))
        if k == len(self.labels) or self.labels[k] != label:
            raise BodyError(f"{self.path}: there is no grid {label}")
        return k

    def number(self, entry: dict[str, Any]) -> None:
        """Numbers from 1 for labels of grids."""
        for key in ("nodes", "relative_to"):
            if not isinstance(entry.get(key), list):
                continue
            for label in map(int, entry[key]):
                k = self.at(label) + 1
                if k in self.references:
                    raise BodyError(
                        f"{self.path}: grid {label} is that of {self.references[k]}: name no other "
                        "interface there"
                    )
                if label not in self.used:
                    raise BodyError(f"{self.path}: grid {label} belongs to no element")
            entry[key] = [self.at(int(label)) + 1 for label in entry[key]]

    def describe(self) -> dict[str, Any]:
        self._expect_known()
        for number, element in sorted(self.model.elements.items()):
            self._element(int(number), element)
        for number, element in self.later:
            if element.type in RODS:
                self._torsion(number, element)
            elif element.type == "CBUSH":
                self._bush(number, element)
            else:
                self._scalar_spring(number, element)
        if not self.groups:
            raise BodyError(f"{self.path}: no solids, shells or beams")
        for number, mass in sorted(self.model.masses.items()):
            self._mass(int(number), mass)
        supported = self._supports()
        for number, rigid in sorted(self.model.rigid_elements.items()):
            self._rigid(int(number), rigid, supported)
        self._join(supported)
        self._attach()
        self._write_supports(supported)
        if not self._param("COUPMASS"):
            self.remarks.append(
                "mass is consistent here, lumped in Nastran without PARAM,COUPMASS: frequencies "
                "differ by the mesh's own error"
            )
        return {
            "materials": self.materials,
            "sections": self.sections,
            "regions": self.regions,
            "masses": self.masses,
            "springs": self.springs,
            "supports": self.supports,
            "interfaces": self.interfaces,
        }

    def mesh(self) -> meshio.Mesh:
        keys = list(self.groups)
        none = np.empty(0, dtype=np.int64)
        return meshio.Mesh(
            self.points,
            [(kind, np.array(self.groups[region, kind][0])) for region, kind in keys],
            cell_sets={
                region: [
                    np.arange(len(self.groups[key][0])) if key[0] == region else none
                    for key in keys
                ]
                for region in dict.fromkeys(region for region, _ in keys)
            },
            cell_data={LABELS: [np.array(self.groups[key][1]) for key in keys]},
        )

    # Elements

    def _element(self, number: int, element: Any) -> None:
        kind = element.type
        nodes = [int(n) for n in element.node_ids if n]
        full = f"{kind}{len(nodes)}"
        ours = {**SOLIDS, **WEDGE}.get(full)
        if ours is not None:
            region = self._solid(number, element)
        elif kind in SHELLS:
            ours, region = SHELLS[kind], self._shell(number, element)
            self.turning.update(nodes)
        elif kind in BEAMS:
            ours, region, nodes = "line", self._beam(number, element), nodes[:2]
            self.turning.update(nodes)
        elif kind in RODS:
            ours, region = "line", self._rod(number, element)
        elif kind in SPRINGS:  # whose nodes are to be known first
            return self.later.append((number, element))
        elif kind in self.ignore:
            return
        else:
            raise self._refuse(kind, number, f"with {len(nodes)} grids is not known")
        self.used.update(nodes)
        order = REORDER.get(ours, range(len(nodes)))
        cells, labels = self.groups.setdefault((region, ours), ([], []))
        cells.append([self.at(nodes[k]) for k in order])
        labels.append(number)

    def _material(
        self, number: int, card: Any, more: float = 0.0, loss: float | None = None
    ) -> str:
        """Name of a material, with ``more`` density, and another loss factor."""
        if card is None:
            raise BodyError(f"{self.path}: property {number}: its material is missing")
        name = f"mat{card.mid}" + (f"_{more:.6g}" if more else "")
        name += "" if loss is None else f"_g{loss:.6g}"
        if name in self.materials:
            return name
        wtmass = self._param("WTMASS") or 1.0
        rho = (float(card.rho or 0.0) + more) * wtmass
        if card.type == "MAT1":
            E, G, nu = card.e, card.g, card.nu
            if E and G and abs(E / (2 * G) - 1 - nu) > 1e-2 * (1 + abs(nu)):
                raise self._refuse("MAT1", card.mid, "E, G and NU do not belong together")
            entry: dict[str, Any] = {"E": float(E), "nu": float(nu), "rho": rho}
        elif card.type == "MAT8":
            E1, E2, nu12, G12 = (float(x) for x in (card.e11, card.e22, card.nu12, card.g12))
            of = {"E1": E1, "E2": E2, "E3": E2, "nu12": nu12, "nu13": 0.0, "nu23": 0.0, "G12": G12}
            of |= {"G13": float(card.g1z or G12), "G23": float(card.g2z or G12), "rho": rho}
            entry = of
        else:
            raise self._refuse(card.type, card.mid, "only MAT1, and MAT8 of shells, are followed")
        if not rho > 0:
            raise self._refuse(card.type, card.mid, "has no density (RHO)")
        loss = float(card.ge or 0.0) if loss is None else loss
        if loss:
            entry["loss_factor"] = loss
        self.materials[name] = entry
        return name

    def _region(self, name: str, material: str, section: str = "") -> str:
        self.regions[name] = {"material": material} if material else {}
        if section:
            self.regions[name]["section"] = section
        return name

    def _solid(self, number: int, element: Any) -> str:
        prop = element.pid_ref
        if prop is None or prop.type != "PSOLID":
            raise self._refuse(element.type, number, "needs a PSOLID")
        if prop.mid_ref is not None and prop.mid_ref.type != "MAT1":
            raise self._refuse("PSOLID", prop.pid, f"{prop.mid_ref.type} is not followed")
        return self._region(f"p{prop.pid}", self._material(prop.pid, prop.mid_ref))

    def _shell(self, number: int, element: Any) -> str:
        prop = element.pid_ref
        given = [t for k in range(1, len(element.nodes) + 1)
                 if (t := getattr(element, f"T{k}", None)) is not None]  # fmt: skip
        if len({float(t) for t in given}) > 1 or (given and len(given) < len(element.nodes)):
            raise self._refuse(element.type, number, "its corners have thicknesses of their own")
        offset = float(element.zoffset or 0.0)
        turned = bool(element.theta_mcid)
        if prop is not None and prop.type == "PSHELL":
            t = float(prop.t or 0.0)
            if given:
                t = float(given[0]) * (t if element.tflag == 1 else 1.0)
            self._expect_plate(prop)
            plane = prop.mid1_ref
            if plane.type == "MAT8":
                of_plane = plane.e11 / (2 + 2 * plane.nu12)
                same = max(abs(plane.e22 / plane.e11 - 1), abs(plane.g12 / of_plane - 1)) < 1e-2
                if turned or not same:
                    raise self._refuse(
                        element.type, number, "a MAT8 is in the element's own axes (THETA, MCID)"
                    )
            if not t > 0:
                raise self._refuse("PSHELL", prop.pid, "has no thickness")
            nsm = float(prop.nsm or 0.0)
            material = self._material(prop.pid, prop.mid1_ref, nsm / t)
            section: dict[str, Any] = {"shape": "shell", "thickness": t, "offset": offset}
            name = f"p{prop.pid}" + (f"_t{t:.9g}" if given else "")
        elif prop is not None and prop.type == "PCOMP":
            material = ""
            if any(m.type == "MAT8" for m in prop.mids_ref):
                raise self._refuse(
                    "PCOMP", prop.pid, "a MAT8 is in the element's own axes (THETA, MCID)"
                )
            if prop.nsm:
                raise self._refuse("PCOMP", prop.pid, "NSM is not followed")
            if prop.lam not in (None, "", "NO", "SYM"):
                raise self._refuse("PCOMP", prop.pid, f"LAM = {prop.lam} is not followed")
            loss = float(prop.ge or 0.0)  # those of its plies do not count
            plies = list(zip(prop.mids_ref, prop.thicknesses, prop.thetas, strict=True))
            if prop.is_symmetrical:
                plies += plies[::-1]
            whole = sum(float(t) for _, t, _ in plies)
            offset += float(prop.z0 or 0.0) + whole / 2
            offset = 0.0 if abs(offset) < 1e-9 * whole else offset
            layers = [
                {
                    "material": self._material(prop.pid, m, 0.0, loss),
                    "thickness": float(t),
                    "angle": float(a),
                }
                for m, t, a in plies
            ]
            section = {"shape": "shell", "layers": layers, "offset": offset}
            name = f"p{prop.pid}"
        else:
            what = "none" if prop is None else prop.type
            raise self._refuse(element.type, number, f"needs a PSHELL or a PCOMP, it has {what}")
        name += f"_z{offset:.9g}" if offset else ""
        self.sections[name] = section
        return self._region(name, material, name)

    def _beam(self, number: int, element: Any) -> str:
        prop, kind = element.pid_ref, element.type
        if np.any(element.wa) or np.any(element.wb):
            raise self._refuse(kind, number, "offsets of its ends (WA, WB) are not followed")
        if element.pa or element.pb:
            raise self._refuse(kind, number, "pins (PA, PB) are not followed")
        ends = [self.points[self.at(int(n))] for n in element.node_ids[:2]]
        if element.g0:
            v = self.points[self.at(int(element.g0))] - ends[0]
        else:
            v = np.asarray(element.x, dtype=float)
            if str(element.offt)[:1] == "G":
                node = self.model.nodes[int(element.node_ids[0])]
                if node.Cd() != 0:
                    if node.cd_ref.type not in ("CORD2R", "CORD1R"):
                        raise self._refuse(kind, number, "its vector is in cylindrical axes (CD)")
                    v = node.cd_ref.beta().T @ v
        along = ends[1] - ends[0]
        if not np.linalg.norm(along) > 0:
            raise self._refuse(kind, number, "it has no length")
        along = along / np.linalg.norm(along)
        v = np.asarray(v, dtype=float)
        if v.shape != (3,) or not np.all(np.isfinite(v)):
            raise self._refuse(kind, number, "it has no orientation vector")
        v = v - along * (v @ along)
        if not np.linalg.norm(v) > 0:
            raise self._refuse(kind, number, "its orientation vector is along it")
        v = np.round(v / np.linalg.norm(v), 9) + 0.0
        if prop is None:
            raise self._refuse(kind, number, "its property is missing")
        try:
            section = beam_section(prop)
        except BodyError as error:
            raise self._refuse(prop.type, prop.pid, str(error)) from None
        name = f"p{prop.pid}_" + "_".join(f"{x:g}" for x in v)
        self.sections[name] = section | {"y_axis": v.tolist()}
        with _named(self.path, f"{prop.type} {prop.pid}: its area is not understood"):
            A, nsm = float(np.ravel(prop.Area())[0]), float(np.ravel(prop.Nsm() or 0.0)[0])
        material = self._material(prop.pid, prop.mid_ref, nsm / A)
        return self._region(name, material, name)

    def _expect_plate(self, prop: Any) -> None:
        """A PSHELL is one homogeneous plate."""
        why = ""
        if not prop.mid1 or prop.mid2 != prop.mid1 or abs((prop.twelveIt3 or 1.0) - 1) > 1e-6:
            why = "MID2 must be MID1, and 12I/T**3 = 1: one homogeneous plate"
        elif prop.mid3 and (prop.mid3 != prop.mid1 or abs((prop.tst or 0.833333) - 5 / 6) > 1e-3):
            why = "MID3 must be MID1, and TS/T = 5/6"
        elif prop.mid4:
            why = "MID4 is not followed"
        if why:
            raise self._refuse("PSHELL", prop.pid, why)
        if not prop.mid3 and not self.told_shear:
            self.told_shear = True
            self.remarks.append(
                "shells without MID3 are stiff in transverse shear in Nastran, here not"
            )

    def _rod(self, number: int, element: Any) -> str:
        prop = self._property(number, element)
        A, J = float(prop.A or 0.0), float(prop.j or 0.0)
        if not A > 0:
            raise self._refuse(element.type, number, "its area must be positive")
        if J > 0:  # felt where both ends have rotations, which all elements tell
            self.later.append((number, element))
        material = self._material(prop.mid, prop.mid_ref, float(prop.nsm or 0.0) / A)
        name = f"rod_{A:.9g}_{material}"
        self.sections[name] = {"shape": "rod", "A": A}
        return self._region(name, material, name)

    def _property(self, number: int, element: Any) -> Any:
        """That of an element, or the element that holds its numbers itself."""
        if element.type in ("CONROD", "CELAS2", "CDAMP2"):
            return element
        if element.pid_ref is None:
            raise self._refuse(element.type, number, "its property is missing")
        return element.pid_ref

    def _torsion(self, number: int, element: Any) -> None:
        """Of a rod, as a spring."""
        prop = self._property(number, element)
        nodes = [int(n) for n in element.node_ids]
        if not set(nodes) <= self.turning:
            return
        ends = self.points[[self.at(n) for n in nodes]]
        length = float(np.linalg.norm(ends[1] - ends[0]))
        along = (ends[1] - ends[0]) / length
        twist = float(prop.mid_ref.g) * float(prop.j) / length
        K = np.kron(np.diag([0.0, twist]), np.outer(along, along))
        entry = {"nodes": [self.at(nodes[0]) + 1], "to_nodes": [self.at(nodes[1]) + 1]}
        self.springs[f"rod{number}"] = entry | {"stiffness": K.tolist()}

    def _scalar_spring(self, number: int, element: Any) -> None:
        """CELAS and CDAMP, with numbers of their own (2) or of a property (1)."""
        source = self._property(number, element)
        is_damper = element.type.startswith("CDAMP")
        nodes = list(element.node_ids if is_damper else element.nodes)
        ends = [
            (int(n), int(c or 0))
            for n, c in zip(nodes, (element.c1, element.c2), strict=False)
            if n
        ]
        if any(not c for _, c in ends):
            raise self._refuse(element.type, number, "scalar points are not followed")
        self._expect_basic(element.type, number, [n for n, _ in ends])
        components = {c for _, c in ends}
        if len(components) > 1:
            raise self._refuse(element.type, number, "it joins different components")
        c = components.pop() - 1
        of_motion = np.zeros((6, 6))
        of_motion[c, c] = float(source.b if is_damper else source.k)
        labels = [n for n, _ in ends]
        if is_damper:
            self._spring(element.type, number, labels, np.zeros((6, 6)), 0.0, of_motion)
        else:
            loss = float(getattr(source, "ge", 0.0) or 0.0)
            self._spring(element.type, number, labels, of_motion, loss)

    def _bush(self, number: int, element: Any) -> None:
        prop = self._property(number, element)
        nodes = [int(n) for n in element.node_ids if n]
        if prop.type != "PBUSH":
            raise self._refuse("CBUSH", number, "only PBUSH is followed")
        if element.ocid not in (-1, None) or getattr(prop, "mass", None):
            raise self._refuse("CBUSH", number, "OCID and M are not followed")
        K = [float(x or 0.0) for x in (list(prop.Ki) + 6 * [0.0])[:6]]
        B = [float(x or 0.0) for x in (list(prop.Bi) + 6 * [0.0])[:6]]
        axes = np.eye(3)
        if element.cid_ref is not None:
            if element.cid_ref.type not in ("CORD2R", "CORD1R"):
                raise self._refuse("CBUSH", number, "its axes (CID) are cylindrical")
            axes = element.cid_ref.beta()
        elif element.x[0] is not None or element.g0:
            raise self._refuse("CBUSH", number, "its axes by a vector or a grid are not followed")
        elif len(nodes) == 2:  # along the line between its grids
            ends = self.points[[self.at(n) for n in nodes]]
            line = ends[1] - ends[0]
            if np.linalg.norm(line) > 0:
                if any(K[1:]) or any(B[1:]):
                    raise self._refuse("CBUSH", number, "across its line its axes are not known")
                x = line / np.linalg.norm(line)
                y = np.cross(x, np.eye(3)[int(np.argmin(np.abs(x)))])
                y /= np.linalg.norm(y)
                axes = np.array([x, y, np.cross(x, y)])
        both = np.kron(np.eye(2), axes)
        self._expect_basic("CBUSH", number, nodes)
        losses = {float(x or 0.0) for x, k in zip(getattr(prop, "GEi", None) or [], K, strict=False)
                  if k}  # fmt: skip
        if len(losses) > 1:
            raise self._refuse("PBUSH", prop.pid, "GE of its directions differ")
        of_motion = [both.T @ np.diag(x) @ both for x in (K, B)]
        loss = losses.pop() if losses else 0.0
        self._spring("CBUSH", number, nodes, of_motion[0], loss, of_motion[1])

    def _expect_basic(self, card: str, number: int, nodes: Sequence[int]) -> None:
        for n in nodes:
            if self.model.nodes[n].Cd() != 0:
                raise self._refuse(card, number, f"grid {n} has axes of its own (CD)")

    def _spring(
        self,
        card: str,
        number: int,
        nodes: Sequence[int],
        K: Floats,
        loss: float,
        B: Floats | None = None,
    ) -> None:
        """Between two grids in one place, or along the line between them; to ground."""
        where = self.points[[self.at(n) for n in nodes]]
        if len(nodes) == 2:
            line = where[1] - where[0]
            length = float(np.linalg.norm(line))
            size = float(np.abs(self.points).max())
            if length > 1e-9 * size:
                along = np.concatenate([line / length, np.zeros(3)])
                for of in (K, B if B is not None else 0 * K):
                    off = of - (along @ of @ along) * np.outer(along, along)
                    if np.abs(off).max() > 1e-9 * np.abs(of).max():
                        raise self._refuse(
                            card, number, "its ends lie apart, and it is not along the line between"
                        )
        if not (np.any(K) or (B is not None and np.any(B))):
            return
        entry: dict[str, Any] = {"nodes": [self.at(nodes[0]) + 1]}
        if len(nodes) == 2:
            entry["to_nodes"] = [self.at(nodes[1]) + 1]
        if np.any(K):
            entry["stiffness"] = K.tolist()
        if B is not None and np.any(B):
            entry["damping"] = B.tolist()
        if loss:
            entry["loss_factor"] = loss
        self.springs[f"{card.lower()}{number}"] = entry

    def _mass(self, number: int, mass: Any) -> None:
        if mass.type != "CONM2":
            if mass.type in self.ignore:
                return
            raise self._refuse(mass.type, number, "only CONM2 is followed")
        if np.any(np.abs(mass.X) > 0):
            raise self._refuse("CONM2", number, "its mass lies beside the grid (X1, X2, X3)")
        if mass.Cid() == -1:
            raise self._refuse("CONM2", number, "CID = -1 is not followed")
        if mass.Cid() != 0 and np.any(mass.I):
            raise self._refuse("CONM2", number, "its inertia is in axes of its own (CID)")
        wtmass = self._param("WTMASS") or 1.0
        xx, yx, yy, zx, zy, zz = (float(x or 0.0) * wtmass for x in mass.I)
        entry: dict[str, Any] = {
            "nodes": [self.at(int(mass.nid)) + 1],
            "mass": float(mass.mass) * wtmass,
        }
        if any((xx, yx, yy, zx, zy, zz)):  # Nastran's I21 = −∫xy
            entry["inertia"] = [xx, yy, zz, -yx, -zy, -zx]
        if entry["mass"] > 0 or "inertia" in entry:
            self.masses[f"conm{number}"] = entry

    # Supports and rigid elements

    def _supports(self) -> dict[int, set[int]]:
        """Components, from 1, that are held at grids: by GRID, and by the SPC of the case."""
        held: dict[int, set[int]] = {}
        for label, node in self.model.nodes.items():
            if node.ps:
                held.setdefault(int(label), set()).update(int(c) for c in str(node.ps))
        cards = []
        for number in self._chosen_supports():
            with _named(self.path, f"SPC {number} is not there"):
                cards += self.model.get_reduced_spcs(int(number), consider_spcadd=True)
        for card in cards:
            if card.type == "SPC1":
                pairs = [(int(n), str(card.components)) for n in card.node_ids]
            elif card.type == "SPC":
                if any(float(x or 0.0) for x in card.enforced):
                    raise BodyError(f"{self.path}: SPC {card.conid} moves grids: not followed")
                pairs = [
                    (int(n), str(c)) for n, c in zip(card.node_ids, card.components, strict=True)
                ]
            else:
                raise BodyError(f"{self.path}: {card.type} is not followed")
            for n, components in pairs:
                held.setdefault(n, set()).update(int(c) for c in components if c != "0")
        return held

    def _chosen_supports(self) -> list[int]:
        """The SPC of the first subcase; of bulk data alone, all."""
        control = self.model.case_control_deck
        if control is None or not self._cases():
            known = sorted({*self.model.spcs, *self.model.spcadds})
            if len(known) > 1:
                self.remarks.append(
                    f"no case control: SPC {', '.join(map(str, known))} all hold it"
                )
            return known
        common = control.subcases[0].params.get("SPC") if 0 in control.subcases else None
        found = [
            of.params.get("SPC", common)
            for number, of in sorted(control.subcases.items())
            if number > 0
        ] or [common]
        numbers = [int(of[0]) for of in found if of is not None]
        if not numbers or found[0] is None:
            if self.model.spcs:
                self.remarks.append("case control chooses no SPC: the body is free")
            return []
        if len(set(numbers)) > 1:
            self.remarks.append(
                f"SPC {numbers[0]} of the first subcase holds the body; others differ"
            )
        return numbers[:1]

    def _write_supports(self, held: dict[int, set[int]]) -> None:
        alike: dict[tuple[int, ...], list[int]] = {}
        lost: list[int] = []
        for label, components in held.items():
            if label not in self.used:
                lost.append(label)
                continue
            kept = {c for c in components if c < 4 or label in self.turning}
            if not kept:
                continue
            node = self.model.nodes[label]
            of_blocks = [{1, 2, 3} & kept, {4, 5, 6} & kept]
            if node.Cd() != 0 and any(len(b) not in (0, 3) for b in of_blocks):
                raise BodyError(
                    f"{self.path}: grid {label} is held in axes of its own (CD): not followed"
                )
            alike.setdefault(tuple(sorted(kept)), []).append(self.at(label) + 1)
        names = ("x", "y", "z", "rx", "ry", "rz")
        for key, nodes in alike.items():
            entry = {"nodes": nodes, "components": [names[c - 1] for c in key]}
            self.supports["held_" + "".join(map(str, key))] = entry
        if lost:
            said = ", ".join(map(str, sorted(lost)[:5])) + (" …" if len(lost) > 5 else "")
            self.remarks.append(
                f"supports of {len(lost)} grids without elements are left out: {said}"
            )

    def _rigid(self, number: int, element: Any, held: dict[int, set[int]]) -> None:
        kind = element.type
        if kind == "RBE2":
            nodes, reference = [int(n) for n in element.Gmi], int(element.Gn())
            if not set("123") <= set(str(element.cm)):
                raise self._refuse(kind, number, f"it couples {element.cm} only, not 123456")
            free = self.turning & set(nodes)
            if free and set(str(element.cm)) != set("123456"):
                raise self._refuse(kind, number, "it leaves rotations of shells or beams free")
        elif kind == "RBE3":
            reference = int(element.ref_grid_id)
            nodes = [int(n) for group in element.Gijs for n in group]
            weights = [
                float(w) for w, g in zip(element.weights, element.Gijs, strict=True) for _ in g
            ]
            if {str(c) for c in element.comps} != {"123"}:
                raise self._refuse(kind, number, "it averages other components than 123")
        else:
            if kind in self.ignore:
                return
            raise self._refuse(kind, number, "only RBE2 and RBE3 are followed")
        if kind == "RBE2":
            self.shared.setdefault(reference, (f"rbe2_{number}", []))[1].extend(nodes)
            return
        if reference in held or reference in self.used:
            raise self._refuse(kind, number, f"its grid {reference} is held, or an element's")
        kept = [(n, w) for n, w in zip(nodes, weights, strict=True) if n in self.used]
        if len(kept) < len(nodes):
            raise self._refuse(kind, number, "some of its grids belong to no element")
        self.interfaces[f"rbe3_{number}"] = {
            "coupling": "distributing",
            "nodes": [self.at(n) + 1 for n in nodes],
            "position": self.points[self.at(reference)].tolist(),
            "weights": weights,
        }
        self.references[self.at(reference) + 1] = f"rbe3_{number}"

    def _join(self, held: dict[int, set[int]]) -> None:
        """RBE2 with one reference are one interface; the grids of one that is held are held."""
        for reference, (name, nodes) in self.shared.items():
            where = f"{self.path}: {name.upper().replace('_', ' ')}"
            if chained := sorted(set(nodes) & set(self.shared)):
                raise BodyError(
                    f"{where}: its grid {chained[0]} moves others: chains are not followed"
                )
            nodes = [n for n in dict.fromkeys(nodes) if n in self.used]
            if not nodes:
                self.remarks.append(f"{name}: its grids belong to no element")
                continue
            if reference in held:
                if not held[reference] >= set(range(1, 7)):
                    raise BodyError(f"{where}: its grid {reference} is held in some components")
                if reference not in self.used:
                    del held[reference]
                    self.grounded.add(self.at(reference) + 1)
                for n in nodes:
                    held.setdefault(n, set()).update(range(1, 7))
                continue
            if fixed := sorted(n for n in nodes if n in held):
                raise BodyError(f"{where}: its grid {fixed[0]} is held by an SPC")
            if reference in self.used:
                nodes.append(reference)
            else:
                self.references[self.at(reference) + 1] = name
            self.interfaces[name] = {
                "coupling": "rigid",
                "nodes": [self.at(n) + 1 for n in nodes],
                "position": self.points[self.at(reference)].tolist(),
            }

    def _attach(self) -> None:
        """Masses and springs at the grid of an RBE2 are its interface's; others need elements."""
        known = {self.at(label) + 1 for label in self.used}
        for entries in (self.masses, self.springs):
            for name, entry in list(entries.items()):
                for nodes, interface in (("nodes", "at"), ("to_nodes", "to")):
                    given = entry.get(nodes, [])
                    if len(given) == 1 and given[0] in self.grounded:
                        entry.pop(nodes)
                    elif len(given) == 1 and given[0] in self.references:
                        entry[interface] = self.references[entry.pop(nodes)[0]]
                    elif lost := [n for n in given if n not in known]:
                        raise BodyError(
                            f"{self.path}: {name}: grid {self.labels[lost[0] - 1]} belongs to no "
                            "element, and to no RBE2: springs alone hold none"
                        )
                if not {"nodes", "at"} & set(entry):  # it begins at what is held
                    for end, start in (("to_nodes", "nodes"), ("to", "at")):
                        if end in entry:
                            entry[start] = entry.pop(end)
                    if not {"nodes", "at"} & set(entry):
                        del entries[name]


@contextlib.contextmanager
def _named(path: Path, what: str) -> Any:
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
