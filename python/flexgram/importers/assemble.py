"""A CalculiX deck assembled by flexgram: nothing of K and M is lost to printed digits.

For solids whose elements are the same in both programs (C3D4, C3D6, C3D8, C3D10, C3D15, C3D20,
C3D20R: equal to the seven digits that CalculiX prints, ``tests/python/test_assemble_deck.py``),
isotropic and orthotropic materials, with shells and beams (CalculiX makes solids of them, which
bend a little differently), trusses, point masses, springs and dashpots, equations and ties; rigid
bodies and couplings become interfaces.
Whatever else a deck says of its stiffness or mass is refused by name: ccx knows it (``--run-ccx``).
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flexgram.basics import BodyError, Floats, errors_of, naming
from flexgram.body.description import import_description
from flexgram.importers.alone import COMPONENTS
from flexgram.importers.ccx import Card, Job, damping_of, frequency_step, read_job
from flexgram.importers.deck import PLANE, TAKEN_AS, Deck, read_deck
from flexgram.importers.deck_axes import axes_of_nodes
from flexgram.importers.deck_constraints import CARDS as CONSTRAINTS
from flexgram.importers.deck_constraints import along, equations_of, ties_of
from flexgram.importers.deck_couplings import CARDS as COUPLINGS
from flexgram.importers.deck_couplings import (
    Coupling,
    add_couplings,
    couplings_of,
    hold_references,
)
from flexgram.importers.deck_instances import flat
from flexgram.importers.deck_lines import BEAMS, TRUSSES
from flexgram.importers.deck_lines import CARDS as LINE_SECTIONS
from flexgram.importers.deck_loads import in_steps, loads_of
from flexgram.importers.deck_mass import CARD as NONSTRUCTURAL
from flexgram.importers.deck_mass import add_nonstructural_mass
from flexgram.importers.deck_materials import materials_of
from flexgram.importers.deck_points import CARDS, TYPES, points_of
from flexgram.importers.deck_sections import (
    materials_of_sections,
    mesh_of,
    regions_of,
    sections_of,
    turn_elements,
    turn_materials,
)
from flexgram.importers.fe import Interface, check_damping
from flexgram.importers.mesh import describe_interfaces, further_keys
from flexgram.importers.shared_load import share

ELEMENTS = ("C3D4", "C3D5", "C3D6", "C3D8", "C3D10", "C3D15", "C3D20", "C3D20R")
#: Taken as hexahedra with incompatible modes. Those of ccx are other modes in distorted elements
#: (C3D8I), or give way by hourglasses (C3D8R).
BENDING = ("C3D8I", "C3D8R")
SHELLS = ("S3", "S3R", "S4", "S4R", "S6", "S8", "S8R", "M3D3", "M3D4", "M3D4R")
#: Cards of the model that are read here, by ``read_deck`` or ``damping_of``.
READ = {
    "NODE",
    "ELEMENT",
    "NSET",
    "ELSET",
    "MATERIAL",
    "ELASTIC",
    "DENSITY",
    "SOLID SECTION",
    "SHELL SECTION",
    "MEMBRANE SECTION",
    *LINE_SECTIONS,
    "ORIENTATION",
    "DISTRIBUTION",
    "BOUNDARY",
    "DAMPING",
    "MODAL DAMPING",
    "VISCOELASTIC",
    NONSTRUCTURAL,
    *CARDS,
    *COUPLINGS,
    *CONSTRAINTS,
}
#: Cards that are nothing to K and M of the unloaded body.
PASSED = {
    "HEADING",
    "DISTRIBUTION TABLE",
    "SURFACE",
    "AMPLITUDE",
    "EXPANSION",
    "CONDUCTIVITY",
    "SPECIFIC HEAT",
    "PHYSICAL CONSTANTS",
    "TIME POINTS",
    "INITIAL CONDITIONS",
    "PLASTIC",
    "CYCLIC HARDENING",
    "CREEP",
    "USER OUTPUT",
    "PREPRINT",
    "FILTER",
    "SECTION CONTROLS",
    "SURFACE INTERACTION",
    "SURFACE BEHAVIOR",
    "FRICTION",
}


#: Cards of materials of which a linear body has nothing.
NOT_LINEAR = ("PLASTIC", "CYCLIC HARDENING", "CREEP")


def _meant(keyword: str) -> str:
    """The keyword that is nearly this one, else what knows others."""
    alike = difflib.get_close_matches(keyword, READ | PASSED, 1, 0.8)
    return f": did you mean *{alike[0]}?" if alike else ": take --run-ccx"


def _refuse_others(job: Job, deck: Deck) -> list[str]:
    """Cards of the model that say something of K or M which is not read here; notes of elements
    that say nothing."""
    of_surfaces = dict[str, None]()
    for card in job.model:
        if card.keyword not in READ | PASSED:
            raise BodyError(f"{card.place} is not supported by --assemble{_meant(card.keyword)}")
        kind = card.options.get("TYPE", "").upper()
        known = (*ELEMENTS, *BENDING, *SHELLS, *BEAMS, *TRUSSES, *TYPES)
        if card.keyword == "ELEMENT" and kind not in (*known, *TAKEN_AS):
            if PLANE.match(kind):
                if any(written in ELEMENTS for written in deck.types.values()):
                    of_surfaces[kind] = None  # of solids, by gmsh
                    continue
                raise BodyError(
                    f"{card.place}: elements {kind} are elements of a plane: gmsh writes these for "
                    "surfaces. Change them to S3 or S4, or import the .msh"
                )
            # A continuum shell (SC8R) is no slip of a shell.
            alike = [] if kind[:2] == "SC" else difflib.get_close_matches(kind, known, 1, 0.7)
            meant = f" (did you mean {alike[0]}?)" if alike else ""
            raise BodyError(
                f"{card.place}: elements {kind} are not supported{meant}. Elements that are: "
                f"{', '.join(known)}. --run-ccx takes the others of CalculiX"
            )
    notes = [
        f"elements {kind} are left out: elements of a plane, which gmsh writes for surfaces of "
        "solids (a section of theirs is refused); their sets name nodes"
        for kind in of_surfaces
    ]
    if beyond := [f"*{word}" for word in NOT_LINEAR if any(c.keyword == word for c in job.model)]:
        notes.append(f"{', '.join(beyond)} left out: the reduced body is linear")
    return notes


#: *BOUNDARY by name, of Abaqus: directions from 1.
HELD = {
    "ENCASTRE": (1, 2, 3, 4, 5, 6),
    "PINNED": (1, 2, 3),
    "XSYMM": (1, 5, 6),
    "YSYMM": (2, 4, 6),
    "ZSYMM": (3, 4, 5),
    "XASYMM": (2, 3, 4),
    "YASYMM": (1, 3, 5),
    "ZASYMM": (1, 2, 6),
}


def supports_of(
    job: Job, deck: Deck, step: Sequence[Card], couplings: Sequence[Coupling] = ()
) -> tuple[dict[str, list[int]], dict[str, Any]]:
    """Nodes that are held, from 0, by the directions in which they are, which commas join; and an
    entry of ``equations`` of those that are held in some axes of their own (*TRANSFORM)."""
    held: dict[int, set[str]] = {}
    turning = deck.turning()
    turning |= {coupling.reference for coupling in couplings}
    for card in (card for card in (*job.model, *step) if card.keyword == "BOUNDARY"):
        for words in card.words():
            try:
                named = HELD.get(words[1].upper())
                first = named[0] if named else int(words[1])
                last = int(words[2]) if len(words) > 2 and words[2] else first
                value = float(words[3]) if len(words) > 3 and words[3] else 0.0
                labels: Iterable[int] = (
                    [int(words[0])] if words[0].isdigit() else deck.sets[words[0].upper()]
                )
            except KeyError:
                raise BodyError(
                    f"{job.path}: *BOUNDARY {', '.join(words)!r}: there is no node set {words[0]}"
                ) from None
            except (IndexError, ValueError):
                raise BodyError(
                    f"{job.path}: *BOUNDARY {', '.join(words)!r}: expected a node or "
                    "node set, and directions"
                ) from None
            if value:
                raise BodyError(
                    f"{job.path}: *BOUNDARY moves nodes by {value:g}: a preload, which "
                    "--run-ccx takes into account"
                )
            for label in labels:
                for direction in named or range(first, min(last, 6) + 1):
                    if direction < 4 or label in turning:
                        held.setdefault(int(label), set()).add(COMPONENTS[direction - 1])
    hold_references(job, held, couplings)
    skew = _held_along_own_axes(job, deck, held)
    alike: dict[str, list[int]] = {}
    for label, directions in held.items():
        at = int(np.searchsorted(deck.labels, label))
        if at < len(deck.labels) and deck.labels[at] == label:
            alike.setdefault(",".join(sorted(directions, key=COMPONENTS.index)), []).append(at)
    alike.pop("", None)
    return alike, {"held_along_own_axes": {"terms": skew}} if skew else {}


def _held_along_own_axes(job: Job, deck: Deck, held: dict[int, set[str]]) -> list[Any]:
    """Equations of nodes with axes of their own that are held in one or two directions, which are
    taken out of ``held``."""
    used = {node for _, nodes in deck.elements.values() for node in nodes}
    found = []
    axes = axes_of_nodes(job, deck)
    for label in sorted(set(axes) & set(held) & used):
        number = deck.index(job.path, label) + 1
        for block in (set(COMPONENTS[:3]), set(COMPONENTS[3:])):
            some = held[label] & block
            if len(some) < 3:
                held[label] -= some
                found += [
                    along(axes, label, number, c, 1.0) for c in sorted(map(COMPONENTS.index, some))
                ]
    return found


def assemble_deck(
    path: Path,
    output: str | Path,
    interfaces: Sequence[Interface],
    *,
    units: str = "SI",
    step: int | None = None,
    alpha: float | None = None,
    beta: float | None = None,
    eta: float | None = None,
    loads: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    deck_loads: bool = False,
    merge: float | None = None,
    keep_repeated: bool = False,
    spin: Mapping[str, Any] | None = None,
    preload: Mapping[str, float] | None = None,
    abaqus: bool = False,
) -> dict[str, Any]:
    """Write a mesh body of a deck, without ccx.

    Parameters
    ----------
    path : Path
        The deck.
    output : str or Path
        Body file to write.
    interfaces : sequence of Interface
        As ``importers.parse`` reads them; node numbers and sets are those of the deck.
    units : str
        Of the deck: ``SI``, ``mm-t-s``, ``mm-kg-s``, ``in-lbf-s`` or ``ft-lbf-s``.
    step : int, optional
        Whose supports hold the body; default: those of the *FREQUENCY step, else of the first.
    alpha, beta, eta : float, optional
        Damping instead of the deck's.
    loads, outputs : mapping, optional
        As in a YAML description; node numbers and sets are those of the deck.
    deck_loads : bool
        Make inputs of the loads of the deck's steps too (``deck_loads.loads_of``).
    merge, keep_repeated, spin, preload
        As of ``import_mesh``. With ``deck_loads`` a preload may be of the deck's loads:
        ``{"step1_cload.load": 1}``.
    abaqus : bool
        The deck is for Abaqus, where it means something else for CalculiX (CIRC of *BEAM SECTION,
        BEAM of *MPC). A deck of instances is.

    Returns
    -------
    dict
        As ``import_body``.

    Raises
    ------
    BodyError
        For a deck that says more of K or M than is followed here.
    """
    check_damping(alpha, beta, eta)
    lines = flat(path)
    job = read_job(path, lines)
    deck = read_deck(path, lines)
    abaqus = abaqus or lines is not None  # CalculiX knows no instances
    of_surfaces = _refuse_others(job, deck)
    if deck.directed:
        raise BodyError(
            f"{path}: beam {deck.directed[0]} has a further node, for its direction 1, which is "
            "not supported: write the direction under *BEAM SECTION"
        )
    number = frequency_step(job, step)
    cards = job.step_of(number or 1) if job.steps else []
    if number and number > 1 and "PERTURBATION" in cards[0].options and not preload:
        raise BodyError(
            f"{path}: step {number} is preloaded (PERTURBATION): name its loads (--deck-loads "
            "--preload step1_cload.load=1), or take --run-ccx"
        )
    materials = materials_of(job) | materials_of_sections(job)
    sections = sections_of(job, deck, abaqus=abaqus)
    mesh, material_of, overlapping = mesh_of(job, deck, materials, sections)
    used = _used_materials(_used_sections(sections, material_of), material_of)
    materials = {name: of for name, of in materials.items() if name in used}
    damping = damping_of(job, used)
    points = points_of(job, deck)
    remarks = [*of_surfaces, *deck.remarks, *damping.remarks, *points.remarks]
    if relaxing := [name for name, of in materials.items() if "viscoelastic" in of]:
        remarks.append(f"relaxation of the deck's materials (*VISCOELASTIC): {', '.join(relaxing)}")
    if damping.loss_factors and eta is None:
        for name, loss in damping.loss_factors.items():
            materials[name] = {**materials[name], "loss_factor": loss}
        said = ", ".join(f"{name} {loss:g}" for name, loss in damping.loss_factors.items())
        remarks.append(f"loss factors of the deck's materials (*DAMPING, STRUCTURAL): {said}")
    if overlapping:
        remarks.append(
            f"{overlapping} elements are in several sections: the last one counts, as in ccx"
        )
    if any(card.options.get("TYPE", "").upper() in ("S3R", "S4R") for card in job.model):
        remarks.append("S3R and S4R are taken as S3 and S4, integrated fully")
    taken = sorted({kind for kind in deck.types.values() if kind in TAKEN_AS})
    for kind in taken:
        locks = ", which is too stiff where nu is near 0.5" if "H" in kind else ""
        remarks.append(f"{kind} are taken as {TAKEN_AS[kind]}{locks}")
    if some := sorted({kind for kind in deck.types.values() if kind in ("S6", "S8", "S8R")}):
        remarks.append(
            f"{' and '.join(some)} are taken as four elements of first order each, which ccx makes "
            "solids: frequencies differ by the elements' own error"
        )
    if bent := sorted({kind for kind in deck.types.values() if kind in BENDING}):
        remarks.append(
            f"{' and '.join(bent)} are taken as hexahedra with incompatible modes, which ccx has "
            "otherwise: frequencies differ by the elements' own error"
        )
    couplings = couplings_of(job, deck)
    supports, skew = supports_of(job, deck, cards, couplings)
    described = describe_interfaces(interfaces)
    loads = {name: dict(entry) for name, entry in (loads or {}).items()}
    outputs = {name: dict(entry) for name, entry in (outputs or {}).items()}
    for name, entry in loads.items():
        if "table" in entry:
            entry["table"] = _by_index(path, deck, f"load {name}", entry["table"])
    if not deck_loads and (words := in_steps(job)):
        remarks.append(
            f"the loads of the deck are left out ({words}): --deck-loads makes inputs of them"
        )
    for entry in (*described.values(), *loads.values(), *outputs.values()):
        number_nodes(path, deck, entry)
    turn_materials(job, material_of, materials)
    turn_elements(job, mesh, material_of, abaqus=abaqus)
    if added := add_nonstructural_mass(job, deck, mesh, material_of, materials, sections):
        remarks += added
        used = _used_materials(_used_sections(sections, material_of), material_of)
        materials = {name: of for name, of in materials.items() if name in used}
    given = {"alpha": alpha, "beta": beta, "eta": eta}
    content: dict[str, Any] = {
        "name": path.stem,
        "units": units,
        "materials": materials,
        "sections": _used_sections(sections, material_of),
        "regions": regions_of(material_of, sections),
        "interfaces": described,
        "mass_integration": "reduced",
        "masses": points.masses,
        "springs": points.springs,
        "equations": equations_of(job, deck, abaqus=abaqus) | skew,
        "ties": ties_of(job, deck),
        "loads": loads,
        "outputs": outputs,
        "supports": {
            "held_" + directions.replace(",", ""): {
                "nodes": [i + 1 for i in nodes],
                "components": directions.split(","),
            }
            for directions, nodes in supports.items()
        },
        "damping": {
            key: getattr(damping, key) if value is None else value for key, value in given.items()
        },
    }
    remarks += add_couplings(job, deck, couplings, content)
    if deck_loads:
        remarks += _add_loads_of_steps(
            job, deck, materials.values(), loads, preload or {}, content["interfaces"]
        )
    content |= further_keys(merge, keep_repeated, spin, preload)
    with naming(path):
        counts = import_description(content, str(path), output, inputs=[path], mesh=mesh)
    return {**counts, "remarks": remarks}


def _used_materials(
    sections: Mapping[str, dict[str, Any]], material_of: Mapping[str, str]
) -> set[str]:
    """Those of regions and of the layers of their sections."""
    layers = {of["material"] for s in sections.values() for of in s.get("layers", ())}
    return {name for name in (*material_of.values(), *layers) if name}


def _used_sections(
    sections: Mapping[str, dict[str, Any]], material_of: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    """Those of regions, whose names begin with that of their section."""
    used = {region.partition("_")[0] for region in material_of}
    return {name: of for name, of in sections.items() if name in used}


def _add_loads_of_steps(
    job: Job,
    deck: Deck,
    materials: Iterable[Mapping[str, float]],
    loads: dict[str, dict[str, Any]],
    preload: Mapping[str, float],
    interfaces: Mapping[str, Mapping[str, Any]],
) -> list[str]:
    """Add the loads of the deck's steps to ``loads``; returns what is to be said of them.
    ``materials``: those of the elements."""
    of_steps, remarks = loads_of(job, deck)
    used = {node for _, nodes in deck.elements.values() for node in nodes}
    references: dict[int, tuple[Coupling, int]] = {}  # and where their rows begin: 3 of rotations
    for coupling in couplings_of(job, deck):
        for node, first in ((coupling.reference, 0), (coupling.rotation, 3)):
            has_place = "position" in interfaces.get(coupling.name, {})
            if node is not None and node not in used and has_place:
                references[node] = coupling, first
    expands = all("expansion" in material for material in materials)
    for load in of_steps:
        if load.name in loads:
            raise BodyError(f"load {load.name} is given twice: it is one of the deck's")
        if load.spins and any(key.startswith(f"{load.name}.") for key in preload):
            remarks.append(
                f"load {load.name} of the preload is centrifugal (CENTRIF): its stress counts; the "
                "softening by that spin, which ccx has too, and its Coriolis forces are left out: "
                "take --spin, or --load turn=spin:… with --preload turn.spin=Ω²"
            )
        if load.kind == "temperature" and not expands:
            remarks.append(
                f"load {load.name} is left out: a material has no *EXPANSION, or "
                "one of temperature or direction"
            )
            continue
        if load.kind == "nodal":
            load = replace(load, table=_shared(deck, load.table, references))
        rows = load.table.copy()
        rows[:, 0] = np.searchsorted(deck.labels, rows[:, 0]) + 1
        loads[load.name] = {"type": load.kind, "table": rows}
    return remarks


def _shared(deck: Deck, table: Floats, references: Mapping[int, tuple[Coupling, int]]) -> Floats:
    """A table of nodal loads whose rows at references act on the nodes of these couplings."""
    if not references.keys() & {int(label) for label in table[:, 0]}:
        return table
    forces: dict[int, Floats] = {}
    for label, *row in table.tolist():
        six = np.array([*row, 0.0, 0.0, 0.0][:6])
        if int(label) not in references:
            forces[int(label)] = forces.get(int(label), np.zeros(6)) + six
            continue
        coupling, first = references[int(label)]
        six = np.roll(six, first)
        at = np.searchsorted(deck.labels, [coupling.reference, *coupling.nodes])
        points = deck.points[at]
        for node, *own in zip(coupling.nodes, *share(points[1:], points[0], six), strict=True):
            forces[node] = forces.get(node, np.zeros(6)) + np.concatenate(own)
    whole = np.array([[label, *six] for label, six in sorted(forces.items())])
    return whole if whole[:, 4:].any() else whole[:, :4]


def number_nodes(path: Path, deck: Deck, entry: dict[str, Any]) -> None:
    """Put numbers from 1 for the deck's labels, and sets in the deck's capitals."""
    for key in ("nodes", "relative_to"):
        if isinstance(entry.get(key), list):
            entry[key] = [deck.index(path, label) + 1 for label in entry[key]]
        elif isinstance(entry.get(key), str):
            entry[key] = entry[key].upper()


def _by_index(path: Path, deck: Deck, what: str, table: Any) -> Any:
    """A table whose first column is labels of the deck, with numbers from 1 instead."""
    with errors_of(f"{path}: {what}"):
        if isinstance(table, str):
            if not Path(table).is_file():
                raise BodyError(f"{table}: no such file")
            table = np.loadtxt(table, delimiter=",", ndmin=2)
        rows = np.array(table, dtype=float)
        rows[:, 0] = [deck.index(path, int(label)) + 1 for label in rows[:, 0]]
    return rows
