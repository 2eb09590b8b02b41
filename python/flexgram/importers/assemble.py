"""A CalculiX deck assembled by flexgram: nothing of K and M is lost to printed digits.

For solids whose elements are the same in both programs (C3D4, C3D6, C3D8, C3D10, C3D15, C3D20,
C3D20R: equal to the seven digits that CalculiX prints, ``tests/python/test_assemble_deck.py``) and
isotropic materials, with shells (S3, S4, S4R; CalculiX makes solids of them, which bend a little
differently), point masses, springs and dashpots, equations and ties; rigid bodies and couplings
become interfaces.
Whatever else a deck says of its stiffness or mass is refused by name: ccx knows it (``--run-ccx``).
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from flexgram.basics import BodyError, errors_of
from flexgram.body.description import import_description
from flexgram.body.meshfile import LABELS
from flexgram.body.meshfile import SHELLS as SHELL_KINDS
from flexgram.importers.ccx import Card, Job, damping_of, frequency_step, read_job
from flexgram.importers.deck import FORMULATIONS, Deck, read_deck
from flexgram.importers.deck_axes import axes_of_nodes
from flexgram.importers.deck_constraints import CARDS as CONSTRAINTS
from flexgram.importers.deck_constraints import along, equations_of, ties_of
from flexgram.importers.deck_couplings import CARDS as COUPLINGS
from flexgram.importers.deck_couplings import Coupling, couplings_of
from flexgram.importers.deck_loads import in_steps, loads_of
from flexgram.importers.deck_points import CARDS, TYPES, points_of
from flexgram.importers.fe import Interface, check_damping
from flexgram.importers.mesh import describe_interfaces, further_keys

ELEMENTS = ("C3D4", "C3D6", "C3D8", "C3D10", "C3D15", "C3D20", "C3D20R")
#: Taken as hexahedra with incompatible modes. Those of ccx are other modes in distorted elements
#: (C3D8I), or give way by hourglasses (C3D8R).
BENDING = ("C3D8I", "C3D8R")
SHELLS = ("S3", "S3R", "S4", "S4R")
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
    "BOUNDARY",
    "DAMPING",
    "MODAL DAMPING",
    "VISCOELASTIC",
    *CARDS,
    *COUPLINGS,
    *CONSTRAINTS,
}
#: Cards that are nothing to K and M of the unloaded body.
PASSED = {
    "HEADING",
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
}


def _numbers(job: Job, card: Card, count: int) -> list[float]:
    """The one row of a card of a material."""
    rows = [words for words in card.words() if any(words)]
    where = f"{job.path}: *{card.keyword}"
    if len(rows) != 1 or card.options.get("TYPE", "ISO").upper() not in ("ISO", "ISOTROPIC"):
        raise BodyError(f"{where}: depends on temperature or direction; --run-ccx knows it")
    try:
        values = [float(word) for word in rows[0][:count]]
    except ValueError:
        values = []
    if len(values) < count:
        raise BodyError(f"{where}: expected {count} number{'s' if count > 1 else ''}")
    return values


def _relaxation(job: Job, card: Card) -> dict[str, Any]:
    """Rows g, k, tau of Abaqus' *VISCOELASTIC, TIME=PRONY: shares of the instantaneous shear and
    bulk modulus, and relaxation times, as YAML has them."""
    where = f"{job.path}: *VISCOELASTIC"
    kind = ", ".join(f"{key}={value}" for key, value in card.options.items()) or "without TIME"
    if card.options.get("TIME", "").upper() != "PRONY":
        raise BodyError(f"{where} ({kind}): only TIME=PRONY is read; give a table in YAML instead")
    try:
        rows = [[float(word or 0) for word in words] for words in card.words() if any(words)]
    except ValueError:
        rows = []
    if not rows or any(len(row) != 3 for row in rows):
        raise BodyError(f"{where}: expected rows of three numbers: g, k and tau")
    if all(g == k for g, k, _ in rows):
        return {"prony": [[g, tau] for g, _, tau in rows]}
    parts = {"shear": [[g, t] for g, _, t in rows if g], "bulk": [[k, t] for _, k, t in rows if k]}
    return {"prony": {part: series for part, series in parts.items() if series}}


def materials_of(job: Job) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    name = ""
    for card in job.model:
        if card.keyword == "MATERIAL":
            name = card.options.get("NAME", "").upper()
            found[name] = {}
        elif card.keyword == "ELASTIC" and name:
            found[name]["E"], found[name]["nu"] = _numbers(job, card, 2)
            if card.options.get("MODULI", "").upper() == "INSTANTANEOUS":
                found[name].setdefault("viscoelastic", {})["moduli"] = "instantaneous"
        elif card.keyword == "VISCOELASTIC" and name:
            found[name].setdefault("viscoelastic", {}).update(_relaxation(job, card))
        elif card.keyword == "DENSITY" and name:
            found[name]["rho"] = _numbers(job, card, 1)[0]
        elif card.keyword == "EXPANSION" and name:
            with contextlib.suppress(BodyError):  # a temperature load will miss it
                found[name]["expansion"] = _numbers(job, card, 1)[0]
    for material in found.values():
        if "prony" not in material.get("viscoelastic", {"prony": None}):
            del material["viscoelastic"]  # *ELASTIC, MODULI of what does not relax
    return found


def _refuse_others(job: Job) -> None:
    """Cards of the model that say something of K or M which is not read here."""
    for card in job.model:
        if card.keyword not in READ | PASSED:
            raise BodyError(
                f"{job.path}: *{card.keyword} is not followed by --assemble: take --run-ccx"
            )
        kind = card.options.get("TYPE", "").upper()
        known = (*ELEMENTS, *BENDING, *SHELLS, *TYPES)
        if card.keyword == "ELEMENT" and kind not in known:
            raise BodyError(
                f"{job.path}: elements {kind} are others than flexgram's, which has "
                f"{', '.join(known)} of CalculiX: take --run-ccx"
            )
        if card.keyword == "SOLID SECTION" and "ORIENTATION" in card.options:
            raise BodyError(f"{job.path}: *SOLID SECTION with an ORIENTATION: take --run-ccx")


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
AXES = ("x", "y", "z", "rx", "ry", "rz")


def supports_of(
    job: Job, deck: Deck, step: Sequence[Card], couplings: Sequence[Coupling] = ()
) -> tuple[dict[str, list[int]], dict[str, Any]]:
    """Nodes that are held, from 0, by the directions in which they are, which commas join; and an
    entry of ``equations`` of those that are held in some axes of their own (*TRANSFORM)."""
    held: dict[int, set[str]] = {}
    turning = {
        node for kind, nodes in deck.elements.values() if kind in SHELL_KINDS for node in nodes
    }
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
            except (IndexError, ValueError, KeyError):
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
                        held.setdefault(int(label), set()).add(AXES[direction - 1])
    _hold_references(job, held, couplings)
    skew = _held_along_own_axes(job, deck, held)
    alike: dict[str, list[int]] = {}
    for label, directions in held.items():
        at = int(np.searchsorted(deck.labels, label))
        if at < len(deck.labels) and deck.labels[at] == label:
            alike.setdefault(",".join(sorted(directions, key=AXES.index)), []).append(at)
    alike.pop("", None)
    return alike, {"held_along_own_axes": {"terms": skew}} if skew else {}


def _held_along_own_axes(job: Job, deck: Deck, held: dict[int, set[str]]) -> list[Any]:
    """Equations of nodes with axes of their own that are held in one or two directions, which are
    taken out of ``held``."""
    used = {node for _, nodes in deck.elements.values() for node in nodes}
    found = []
    axes = axes_of_nodes(job, deck)
    for label in sorted(set(axes) & set(held) & used):
        number = _index(job.path, deck, label) + 1
        for block in (set(AXES[:3]), set(AXES[3:])):
            some = held[label] & block
            if len(some) < 3:
                held[label] -= some
                found += [along(axes, label, number, c, 1.0) for c in sorted(map(AXES.index, some))]
    return found


def _ground(content: dict[str, Any], number: int) -> None:
    """A node that is held carries no mass, and springs end at the ground there."""
    masses, springs = content["masses"], content["springs"]
    for name in [name for name, of in masses.items() if of.get("nodes") == [number]]:
        del masses[name]
    for name, of in list(springs.items()):
        if of.get("to_nodes") == [number]:
            del of["to_nodes"]
        elif of.get("nodes") == [number] and "to_nodes" in of:
            of["nodes"] = of.pop("to_nodes")
        elif of.get("nodes") == [number]:
            del springs[name]


def _hold_references(job: Job, held: dict[int, set[str]], couplings: Sequence[Coupling]) -> None:
    """The nodes of a coupling whose reference is held are held, instead of it."""
    for coupling in couplings:
        directions = held.pop(coupling.reference, set())
        if coupling.rotation is not None:
            directions |= {f"r{axis}" for axis in held.pop(coupling.rotation, set())}
        if not directions:
            continue
        if directions != set(AXES) or coupling.kind != "rigid":
            raise BodyError(
                f"{job.path}: the reference node {coupling.reference} of {coupling.name} is held "
                "in some directions: take --run-ccx"
            )
        for label in coupling.nodes:
            held.setdefault(label, set()).update(AXES)


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
        Of the deck: ``SI``, ``mm-t-s`` or ``mm-kg-s``.
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
    job = read_job(path)
    _refuse_others(job)
    deck = read_deck(path)
    number = frequency_step(job, step)
    cards = job.step_of(number or 1) if job.steps else []
    if number and number > 1 and "PERTURBATION" in cards[0].options and not preload:
        raise BodyError(
            f"{path}: step {number} is preloaded (PERTURBATION): name its loads (--deck-loads "
            "--preload step1_cload.load=1), or take --run-ccx"
        )
    materials = materials_of(job)
    mesh, material_of, overlapping = mesh_of(job, deck, materials)
    shells = shell_sections(job)
    damping = damping_of(job)
    points = points_of(job, deck)
    remarks = [*deck.remarks, *damping.remarks, *points.remarks]
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
    if deck_loads:
        remarks += _add_loads_of_steps(job, deck, materials, material_of, loads)
    elif words := in_steps(job):
        remarks.append(
            f"the loads of the deck are left out ({words}): --deck-loads makes inputs of them"
        )
    for entry in (*described.values(), *loads.values(), *outputs.values()):
        number_nodes(path, deck, entry)
    given = {"alpha": alpha, "beta": beta, "eta": eta}
    content = {
        "name": path.stem,
        "units": units,
        "materials": materials,
        "sections": {region: of for region, of in shells.items() if region in material_of},
        "regions": regions_of(material_of, shells),
        "interfaces": described,
        "mass_integration": "reduced",
        "masses": points.masses,
        "springs": points.springs,
        "equations": equations_of(job, deck) | skew,
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
    _add_couplings(job, deck, couplings, content)
    content |= further_keys(merge, keep_repeated, spin, preload)
    counts = import_description(content, str(path), output, inputs=[path], mesh=mesh)
    return {**counts, "remarks": remarks}


def _add_couplings(
    job: Job, deck: Deck, couplings: Sequence[Coupling], content: dict[str, Any]
) -> None:
    """Their interfaces, unless they are held, and what is at their reference nodes."""
    used = {node for _, nodes in deck.elements.values() for node in nodes}
    held = {i for s in content["supports"].values() for i in s["nodes"]}
    for coupling in couplings:
        entry = coupling.entry(deck)
        number = _index(job.path, deck, coupling.reference) + 1
        if coupling.kind == "rigid" and set(entry["nodes"]) <= held:
            _ground(content, number)
            continue
        if coupling.name in content["interfaces"]:
            raise BodyError(f"interface {coupling.name} is given twice: it is one of the deck's")
        content["interfaces"][coupling.name] = entry
        if coupling.reference in used:
            if coupling.kind == "rigid":
                entry["nodes"].append(number)
            continue
        for entries in (content["masses"], content["springs"]):
            for of in entries.values():
                for nodes, interface in (("nodes", "at"), ("to_nodes", "to")):
                    if of.get(nodes) == [number]:
                        del of[nodes]
                        of[interface] = coupling.name


def _sections(job: Job) -> list[tuple[str, Card]]:
    """*SOLID SECTION and *SHELL SECTION, each with the name of its region."""
    cards = [c for c in job.model if c.keyword in ("SOLID SECTION", "SHELL SECTION")]
    return [(f"section{number}", card) for number, card in enumerate(cards, 1)]


def shell_sections(job: Job) -> dict[str, dict[str, Any]]:
    """Entries of ``sections`` of a description, by region."""
    found: dict[str, dict[str, Any]] = {}
    for region, card in _sections(job):
        if card.keyword != "SHELL SECTION":
            continue
        where = f"{job.path}: *SHELL SECTION, ELSET={card.options.get('ELSET', '')}"
        for option in card.options:
            if option not in ("ELSET", "MATERIAL", "OFFSET", "SECTION INTEGRATION"):
                raise BodyError(f"{where}: {option} is not followed by --assemble: take --run-ccx")
        rows = [words for words in card.words() if any(words)]
        try:
            thickness = float(rows[0][0])
            offset = {"SPOS": 0.5, "SNEG": -0.5}.get(
                given := card.options.get("OFFSET", "0").upper()
            )
            offset = float(given) if offset is None else offset
        except (IndexError, ValueError):
            raise BodyError(
                f"{where}: expected a thickness, and an OFFSET in thicknesses"
            ) from None
        # Of the nodes above the middle surface.
        found[region] = {"shape": "shell", "thickness": thickness, "offset": -offset * thickness}
    return found


def regions_of(
    material_of: Mapping[str, str], shells: Mapping[str, Any]
) -> dict[str, dict[str, str]]:
    """Entries of ``regions`` of a description, of what ``mesh_of`` returns."""
    entries: dict[str, dict[str, str]] = {}
    for region, material in material_of.items():
        entries[region] = {"material": material}
        if region in shells:
            entries[region]["section"] = region
        _, _, formulation = region.partition("_")
        if formulation:
            entries[region]["formulation"] = formulation
    return entries


def mesh_of(
    job: Job, deck: Deck, materials: Mapping[str, Mapping[str, float]]
) -> tuple[meshio.Mesh, dict[str, str], int]:
    """The mesh with a region for each section, the material of each region, and how many elements
    are in several sections, of which the last one counts."""
    material_of: dict[str, str] = {}
    region_of: dict[int, str] = {}  # of each element
    given = 0
    for region, card in _sections(job):
        name, material = (card.options.get(key, "").upper() for key in ("ELSET", "MATERIAL"))
        where = f"{job.path}: *{card.keyword}, ELSET={name}, MATERIAL={material}"
        if name not in deck.elsets or not {"E", "nu", "rho"} <= set(materials.get(material, ())):
            raise BodyError(f"{where}: needs elements, *ELASTIC and *DENSITY")
        of_shells = card.keyword == "SHELL SECTION"
        others = [e for e in deck.elsets[name] if (deck.elements[e][0] in SHELL_KINDS) != of_shells]
        if others:
            raise BodyError(f"{where}: its element {others[0]} is a {deck.elements[others[0]][0]}")
        for label in deck.elsets[name]:
            formulation = FORMULATIONS.get(deck.types[label])
            region_of[label] = region + (f"_{formulation}" if formulation else "")
            material_of[region_of[label]] = material
        given += len(set(deck.elsets[name]))
    if len(region_of) < len(deck.elements):
        raise BodyError(
            f"{job.path}: {len(deck.elements) - len(region_of)} elements have no *SOLID SECTION or "
            "*SHELL SECTION"
        )
    groups: dict[tuple[str, str], list[int]] = {}  # labels by region and kind
    for label, region in region_of.items():
        groups.setdefault((region, deck.elements[label][0]), []).append(label)
    cells = [
        (kind, np.searchsorted(deck.labels, np.array([deck.elements[e][1] for e in labels])))
        for (_, kind), labels in groups.items()
    ]
    none = np.empty(0, dtype=np.int64)
    used = {region for region, _ in groups}
    mesh = meshio.Mesh(
        deck.points,
        cells,
        point_sets={
            name: np.searchsorted(deck.labels, nodes[np.isin(nodes, deck.labels)])
            for name, nodes in deck.sets.items()
        },
        cell_sets={
            region: [
                np.arange(len(labels)) if owner == region else none
                for (owner, _), labels in groups.items()
            ]
            for region in used
        },
        cell_data={LABELS: [np.array(labels) for labels in groups.values()]},
    )
    kept = {region: material for region, material in material_of.items() if region in used}
    return mesh, kept, given - len(region_of)


def _add_loads_of_steps(
    job: Job,
    deck: Deck,
    materials: Mapping[str, Mapping[str, float]],
    material_of: Mapping[str, str],
    loads: dict[str, dict[str, Any]],
) -> list[str]:
    """Add the loads of the deck's steps to ``loads``; returns what is to be said of them."""
    of_steps, remarks = loads_of(job, deck)
    shells = any(kind in SHELL_KINDS for kind, _ in deck.elements.values())
    used = {node for _, nodes in deck.elements.values() for node in nodes}
    references = {
        node
        for coupling in couplings_of(job, deck)
        for node in (coupling.reference, coupling.rotation)
        if node is not None and node not in used
    }
    expands = all("expansion" in materials[name] for name in material_of.values())
    for load in of_steps:
        if load.name in loads:
            raise BodyError(f"load {load.name} is given twice: it is one of the deck's")
        if load.kind == "temperature" and not expands:
            remarks.append(
                f"load {load.name} is left out: a material has no *EXPANSION, or "
                "one of temperature or direction"
            )
            continue
        at_references = {int(label) for label in load.table[:, 0]} & references
        if load.kind == "nodal" and at_references:
            remarks.append(
                f"load {load.name} is left out: it acts at reference nodes "
                f"({', '.join(map(str, sorted(at_references)))}), whose interfaces are inputs"
            )
            continue
        if load.kind == "temperature" and shells:
            remarks.append(f"load {load.name} is left out: shells take no temperature")
            continue
        rows = load.table.copy()
        rows[:, 0] = np.searchsorted(deck.labels, rows[:, 0]) + 1
        loads[load.name] = {"type": load.kind, "table": rows}
    return remarks


def number_nodes(path: Path, deck: Deck, entry: dict[str, Any]) -> None:
    """Put numbers from 1 for the deck's labels, and sets in the deck's capitals."""
    for key in ("nodes", "relative_to"):
        if isinstance(entry.get(key), list):
            entry[key] = [_index(path, deck, label) + 1 for label in entry[key]]
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
        rows[:, 0] = [_index(path, deck, int(label)) + 1 for label in rows[:, 0]]
    return rows


def _index(path: Path, deck: Deck, label: int) -> int:
    at = int(np.searchsorted(deck.labels, label))
    if at == len(deck.labels) or deck.labels[at] != label:
        raise BodyError(f"{path}: there is no node {label}")
    return at
