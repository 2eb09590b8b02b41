"""A mesh body as a whole: repeated elements, parts that nothing joins, mass, free motions, units.

Nothing here changes the body, but for ``merged_nodes``, which is asked for.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from flexgram.basics import BodyError, Floats, Ints, counted
from flexgram.body.constraints import COMPONENTS, Constraints
from flexgram.body.discrete import Places
from flexgram.body.free_motions import alone_in, free_motions, springs_of
from flexgram.body.meshfile import SHELLS
from flexgram.body.terms import law_of
from flexgram.body.units import UNITS, doubt
from flexgram.body.varying_laws import PRODUCT

#: Thickness of shells over the size of a body: below that its unit is doubted.
THINNEST = 1e-4
#: Where programs differ in the order of the nodes of an element.
NODE_ORDERS = {
    "tetra10": "The last two nodes of a tetra10 change places from gmsh to CalculiX and Abaqus",
    "hexahedron20": "The middle nodes of a hexahedron20 come in other orders in gmsh, Nastran and "
    "Abaqus",
}
#: Nodes this close, relative to the size of the body, are meant to be one.
NEAR = 1e-6


@dataclass
class Block:
    """Elements of one type and material: nodes (n, k) 0-based, and their numbers in the mesh."""

    kind: str
    nodes: Ints
    ids: Ints


def expect_no_repeats(blocks: Sequence[Block]) -> None:
    """Refuse elements that use the same nodes as another one: stiffness and mass would count twice.

    Raises
    ------
    BodyError
        With the numbers of the first pair and how many there are.
    """
    by_size: dict[int, list[tuple[Ints, Ints]]] = {}
    for block in blocks:
        by_size.setdefault(block.nodes.shape[1], []).append((block.nodes, block.ids))
    for some in by_size.values():
        nodes = np.sort(np.vstack([n for n, _ in some]), axis=1)
        ids = np.concatenate([i for _, i in some])
        order = np.lexsort(nodes.T[::-1])
        same = (np.diff(nodes[order], axis=0) == 0).all(axis=1)
        if not same.any():
            continue
        k = int(np.argmax(same))
        first, second = sorted((int(ids[order[k]]), int(ids[order[k + 1]])))
        raise BodyError(
            f"elements {first} and {second} have the same nodes, and their stiffness and mass "
            f"would count twice ({int(same.sum())} such pairs; gmsh's format MSH 2.2 repeats "
            "elements of two physical groups: save as MSH 4.1). If they are meant to be two: "
            "--keep-repeated, in YAML repeated_elements: keep"
        )


def merged_nodes(points: Floats, used: NDArray[np.bool_], tolerance: float) -> Ints:
    """For each node (N,) the number of the node that takes its place: of nodes no farther apart
    than ``tolerance``, in a chain, the first."""
    chosen = np.flatnonzero(used)
    pairs = cKDTree(points[chosen]).query_pairs(tolerance, output_type="ndarray")
    labels = _components(len(chosen), [pairs])
    first = np.full(labels.max(initial=-1) + 1, len(points), dtype=np.int64)
    np.minimum.at(first, labels, chosen)
    place = np.arange(len(points), dtype=np.int64)
    place[chosen] = first[labels]
    return place


def _components(count: int, edges: Iterable[Ints]) -> Ints:
    """Which part each of ``count`` nodes belongs to, by edges (n, 2)."""
    some = [e for e in edges if len(e)]
    both = np.vstack(some) if some else np.empty((0, 2), dtype=np.int64)
    graph = coo_matrix((np.ones(len(both), dtype=np.int8), both.T), shape=(count, count))
    labels: Ints = connected_components(graph, directed=False)[1].astype(np.int64)
    return labels


def _chain(nodes: Ints) -> Ints:
    """Edges that join all nodes of each row."""
    return np.column_stack([nodes[:, :-1].ravel(), nodes[:, 1:].ravel()])


@dataclass
class Parts:
    """Connected components of the elements and of what interfaces join, largest first."""

    label: Ints  #: of each node, -1 of nodes without an element
    nodes: list[int] = field(default_factory=list)  #: how many each has

    @classmethod
    def of(cls, count: int, blocks: Sequence[Block], joined: Iterable[Ints]) -> Parts:
        """Of ``count`` nodes; ``joined``: nodes that an interface moves together."""
        edges = [_chain(block.nodes) for block in blocks]
        edges += [_chain(nodes[None, :]) for nodes in joined if len(nodes) > 1]
        label = _components(count, edges)
        used = np.zeros(count, dtype=bool)
        for block in blocks:
            used[block.nodes.ravel()] = True
        numbers, inverse, sizes = np.unique(label[used], return_inverse=True, return_counts=True)
        rank = np.argsort(np.argsort(-sizes, kind="stable"))
        whole = np.full(count, -1, dtype=np.int64)
        whole[used] = rank[inverse]
        return cls(whole, np.sort(sizes)[::-1].tolist() if len(numbers) else [])

    def gap(self, points: Floats) -> tuple[float, int, int]:
        """The least distance of a node of the first part from one of another part, and both nodes
        (1-based)."""
        first, rest = np.flatnonzero(self.label == 0), np.flatnonzero(self.label > 0)
        distance, at = cKDTree(points[first]).query(points[rest])
        k = int(np.argmin(distance))
        return float(distance[k]), int(first[at[k]]) + 1, int(rest[k]) + 1


def doubts_of_parts(
    points: Floats, parts: Parts, interfaces: dict[str, Ints], supported: Ints
) -> list[str]:
    """Warnings of a body that is several: how many parts, where they nearly touch, and interfaces
    that hang on different ones. ``points`` in the mesh's own units."""
    if len(parts.nodes) < 2:
        return []
    sizes = ", ".join(str(n) for n in parts.nodes[:5]) + (" …" if len(parts.nodes) > 5 else "")
    words = f"the mesh has {len(parts.nodes)} parts that nothing joins ({sizes} nodes)"
    distance, one, other = parts.gap(points)
    extent = float(np.ptp(points[parts.label >= 0], axis=0).max())
    if distance <= NEAR * extent:
        words += (
            f"; nodes {one} and {other} lie in the same place: are they meant to be one? "
            f"--merge {max(distance, NEAR * extent):.0e} (YAML merge: …, in the mesh's units) "
            "merges such nodes"
        )
    else:
        words += f"; the next are nodes {one} and {other}, {distance:.3g} apart (in its units)"
    found = [words]
    where = {name: sorted(set(parts.label[nodes].tolist())) for name, nodes in interfaces.items()}
    several = {tuple(on) for on in where.values()}
    if len(several) > 1:
        names = "; ".join(
            f"{name} on part {', '.join(str(p + 1) for p in on)}" for name, on in where.items()
        )
        found.append(f"forces do not pass between interfaces of different parts: {names}")
    loose = set(range(len(parts.nodes))) - {p for on in where.values() for p in on}
    loose -= set(parts.label[supported].tolist())
    if loose:
        found.append(
            f"{len(loose)} of the parts {'has' if len(loose) == 1 else 'have'} "
            "neither an interface nor a support: nothing holds "
            "or moves them"
        )
    return found


@dataclass
class MassFacts:
    """Mass [kg], centre of mass [m] and inertia about it [kg m²], (3,) and (3, 3), of masses that
    differ by direction with their mean; solids that are inverted or flat, in words; the mass along
    x, y, z (3,)."""

    mass: float
    centre: Floats
    inertia: Floats
    inverted: str
    along: Floats

    @property
    def words(self) -> str:
        """Mass, along each axis where that differs, centre and inertia."""
        at = ", ".join(f"{x:.6g}" for x in self.centre)
        rest = f"centre ({at}) m, inertia about it {words_of_inertia(self.inertia)}"
        if np.ptp(self.along) <= 1e-9 * np.abs(self.along).max():
            return f"mass {self.mass:.6g} kg, {rest}"
        own = ", ".join(f"{x:.6g}" for x in self.along)
        return f"mass along x, y, z {own} kg; of their mean, {self.mass:.6g} kg: {rest}"


def _across(file: h5py.File, block: h5py.Group) -> tuple[float, float, float]:
    """Of a block of shells: mass by area [kg/m²], height of its centre above the nodes [m], and
    second moment about that [kg]."""
    section = file["sections"][str(block.attrs["section"])].attrs
    names = section.get("layer_materials", [block.attrs["material"]])
    t = np.atleast_1d(section.get("layer_thicknesses", section["thickness"]))
    rho = np.array([float(file["materials"][str(name)].attrs["rho"]) for name in names])
    z = np.cumsum(t) - 0.5 * t - 0.5 * t.sum() + float(section["offset"])
    mass = float(rho @ t)
    height = float(rho * t @ z) / mass if mass > 0 else 0.0
    return mass, height, float(rho * t @ ((z - height) ** 2 + t**2 / 12))


def mass_facts(file: h5py.File) -> MassFacts:
    """Of a mesh body's elements and point masses, supports and interfaces apart: integrals over
    each by the points of its mass matrix, beams along their axes."""
    import _flexgram

    points = file["mesh/points"][:]
    mass, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    inverted, solids = [], 0
    reduced = file["mesh"].attrs.get("mass_integration") == "reduced"
    for block in file["mesh/blocks"].values():
        kind, every = str(block.attrs["type"]), block["connectivity"][:]
        if kind in SHELLS:
            density, height, spread = _across(file, block)
        else:
            density = float(file["materials"][str(block.attrs["material"])].attrs["rho"])
        if kind == "line":
            density *= float(file["sections"][str(block.attrs["section"])].attrs["A"])
            at, weight = np.array([-1, 1]) / np.sqrt(3), np.ones(2)
            N = np.column_stack([1 - at, 1 + at]) / 2
        else:
            _, weight, N, dN = _flexgram.mass_points(kind)
            at_points = _flexgram.shape_functions(kind, np.empty((0, 3)))[3]  # of its stiffness
        for start in range(0, len(every), 20_000):
            x = points[every[start : start + 20_000]]
            above = 0.0  # of the mass over its points
            if kind == "line":
                size = 0.5 * np.linalg.norm(x[:, 1] - x[:, 0], axis=1)[:, None]
            elif kind in SHELLS:
                along = np.einsum("qka,ekb->eqab", dN[:, :, :2], x)
                normal = np.cross(along[:, :, 0], along[:, :, 1])
                size = np.linalg.norm(normal, axis=2)
                normal /= np.maximum(size, 1e-300)[:, :, None]
                above = height * normal
                turned = np.einsum("eq,eqa,eqb->ab", size * weight, normal, normal, optimize=True)
                second += spread * turned
            else:
                volume = np.linalg.det(np.einsum("qka,ekb->eqab", dN, x))
                looked_at = volume  # where the program looks
                if reduced:
                    looked_at = np.linalg.det(np.einsum("qka,ekb->eqab", at_points, x))
                wrong = np.flatnonzero(looked_at.min(axis=1) <= 0)
                inverted += [(kind, int(block["ids"][start + k])) for k in wrong]
                solids += len(x)
                size = np.abs(volume)
            w = density * size * weight
            place = np.einsum("qk,ekb->eqb", N, x) + above
            mass += float(w.sum())
            first += np.einsum("eq,eqb->b", w, place)
            second += np.einsum("eq,eqa,eqb->ab", w, place, place, optimize=True)
    places, beside = Places(file), np.zeros(3)  # the mean mass
    for point in file.get("masses", {}).values():
        each = float(point.attrs["mass"])
        where = places.positions(point) + np.asarray(point.attrs.get("offset", np.zeros(3)))
        xx, yy, zz, xy, yz, zx = np.asarray(point.attrs["inertia"])
        inertia = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
        if "matrix" in point.attrs:
            beside += len(where) * (np.reshape(point.attrs["matrix"], (6, 6)).diagonal()[:3] - each)
        mass += each * len(where)
        first += each * where.sum(axis=0)
        second += each * where.T @ where
        second += len(where) * (0.5 * np.trace(inertia) * np.eye(3) - inertia)
    centre = first / mass if mass > 0 else first
    about = second - mass * np.outer(centre, centre)
    inertia = np.trace(about) * np.eye(3) - about
    return MassFacts(mass, centre, inertia, _said_of_inverted(inverted, solids), mass + beside)


def _said_of_inverted(inverted: list[tuple[str, int]], solids: int) -> str:
    """Of the kinds and numbers of such elements, among so many solids."""
    if not inverted:
        return ""
    kind, number = inverted[0]
    words = f"element {number} ({kind}) is inverted or flat"
    if len(inverted) > 1:
        words += f", and {len(inverted) - 1} more"
    if len(inverted) == solids:
        return words + ": is the mesh mirrored, or the order of its nodes another one?"
    if kind in NODE_ORDERS:
        return words + f": is the order of its nodes right? {NODE_ORDERS[kind]}"
    return words + ": its mesh is distorted there"


def doubts_of_units(file: h5py.File, system: str, extent: Floats) -> list[str]:
    """What speaks against the units in which the mesh and its materials were given."""
    length, mass, _ = UNITS[system]
    found = []
    weighing = {str(block.attrs["material"]) for block in file["mesh/blocks"].values()}
    materials = file.get("materials", {})
    heavy = any(float(material.attrs["rho"]) > 0 for material in materials.values())
    if weighing and not heavy and not len(file.get("masses", {})):
        found.append("the body has no mass at all: nothing vibrates")
    for name, material in materials.items():
        a = material.attrs
        moduli = a.get("E", a.get("engineering_constants", a.get("stiffness", 0)))
        E, rho = float(np.ravel(moduli)[0]), float(a["rho"])
        if rho == 0 and name in weighing:
            found.append(f"material {name} has no density: what is made of it weighs nothing")
        if not (E > 0 and rho > 0):
            continue
        speed = np.sqrt(E / rho) / length
        said = doubt(system, speed, rho / (mass / length**3), float(np.max(extent)) / length)
        if said:
            found.append(f"material {name}: {said}")
    return found


def words_of_inertia(inertia: Floats) -> str:
    """Moments of inertia, (3, 3) [kg m²], and their products where there are some."""
    said = "xx, yy, zz " + ", ".join(f"{x:.6g}" for x in np.diag(inertia))
    products = inertia[[0, 1, 2], [1, 2, 0]]
    if np.abs(products).max() > 1e-6 * np.abs(np.diag(inertia)).max():
        said += "; xy, yz, zx " + ", ".join(f"{x:.4g}" for x in products)
    return said + " kg m²"


def free_in(file: h5py.File) -> int:
    """How many rigid motions of a mesh body nothing holds."""
    held = [
        (group["nodes"][:], [int(c) for c in np.ravel(group.attrs["components"])])
        for group in file.get("supports", {}).values()
    ]
    points, constraints = file["mesh/points"][:], Constraints.of(file)
    return free_motions(points, held, springs_of(file), constraints, alone_in(file))


def _said_of_supports(file: h5py.File) -> list[str]:
    """How many nodes each support holds, and in which directions."""
    names = list(COMPONENTS)
    return [
        f"support {name}: {len(group['nodes'])} nodes held in "
        + ", ".join(names[int(c)] for c in np.ravel(group.attrs["components"]))
        for name, group in file.get("supports", {}).items()
    ]


def _said_of_shells(file: h5py.File) -> list[str]:
    """Thickness of each section of shells, and how many elements have it."""
    count: dict[str, int] = {}
    for block in file["mesh/blocks"].values():
        if str(block.attrs["type"]) in SHELLS:
            name = str(block.attrs["section"])
            count[name] = count.get(name, 0) + len(block["connectivity"])
    shown = list(count.items())[:12]
    lines = [
        f"shells of section {name}: {1e3 * _thickness(file, name):.4g} mm thick, "
        f"{counted(number, 'element')}"
        for name, number in shown
    ]
    return lines + [f"and {len(count) - 12} more sections of shells"] * (len(count) > 12)


def _said_of_beams(file: h5py.File) -> list[str]:
    """Area, moments of area and direction of each section of beams, in millimetres."""
    count: dict[str, int] = {}
    for block in file["mesh/blocks"].values():
        if str(block.attrs["type"]) == "line":
            name = str(block.attrs["section"])
            count[name] = count.get(name, 0) + len(block["connectivity"])
    lines = []
    for name, number in list(count.items())[:12]:
        a = file["sections"][name].attrs
        words = f"of section {name}: A = {1e6 * float(a['A']):.4g} mm²"
        if "I_y" in a:
            axis = ", ".join(f"{x + 0.0:.3g}" for x in np.asarray(a["y_axis"]))
            words += (
                f", I_y, I_z = {1e12 * float(a['I_y']):.4g}, {1e12 * float(a['I_z']):.4g} mm⁴, "
                f"local y along ({axis})"
            )
        kind = "beams" if "I_y" in a else "rods"
        lines.append(f"{kind} {words}, {counted(number, 'element')}")
    return lines + [f"and {len(count) - 12} more sections of beams"] * (len(count) > 12)


def _thickness(file: h5py.File, section: str) -> float:
    """Of a section of shells [m]."""
    of = file["sections"][section].attrs
    return float(np.sum(of.get("layer_thicknesses", of.get("thickness", 0.0))))


def doubts_of_thickness(file: h5py.File, extent: Floats) -> list[str]:
    """Shells that are much thinner than any sheet of a body of this size."""
    sections = {
        str(block.attrs["section"])
        for block in file["mesh/blocks"].values()
        if str(block.attrs["type"]) in SHELLS
    }
    size = float(np.max(extent))
    return [
        f"section {name}: shells of {1e3 * t:.3g} mm on a body of {1e3 * size:.4g} mm: is the "
        "thickness in the units of the mesh?"
        for name in sorted(sections)
        if (t := _thickness(file, name)) < THINNEST * size
    ]


def words_of_materials(file: h5py.File) -> list[str]:
    """A line for each material: moduli, laws, density."""
    lines = []
    for name, material in file.get("materials", {}).items():
        a = material.attrs
        if "E" in a:
            words = f"E = {float(a['E']):.4g} Pa, nu = {float(a['nu']):g}"
        else:
            by_matrix = "stiffness" in a
            moduli = np.ravel(a["stiffness"])[::7] if by_matrix else a["engineering_constants"]
            said = ", ".join(f"{x:.4g}" for x in np.ravel(moduli)[:3])
            words = f"{'anisotropic, C' if by_matrix else 'orthotropic, E'} = {said} Pa"
        if a.get("loss_factor"):
            words += f", loss factor {float(a['loss_factor']):g}"
        for part, group in material.items():
            law = law_of(str(group.attrs["law"]), group.attrs, f"material {name}")
            words += f", {law.words}"
            if part in ("shear", "bulk"):
                words += f" of the {part} modulus"
        lines.append(f"material {name}: {words}, rho = {float(a['rho']):.4g} kg/m³")
    return lines


def summary(file: h5py.File, parts: int = 1) -> list[str]:
    """What to check in a mesh body, in lines: mass, free motions, materials, damping, all in SI.
    ``parts``: how many the mesh has that nothing joins.

    Raises
    ------
    BodyError
        For solids that are inverted or flat.
    """
    facts = mass_facts(file)
    if facts.inverted:
        raise BodyError(facts.inverted)
    free = free_in(file)
    lines = [
        facts.words,
        f"{free} of 6 rigid motions are free"
        + (f" of the mesh as one body; it has {parts} parts that nothing joins" * (parts > 1)),
        *_said_of_supports(file),
    ]
    if dependent := len(Constraints.of(file).dependent):
        lines.append(f"{dependent} dependent dofs follow others, by equations and ties")
    lines += _said_of_shells(file) + _said_of_beams(file) + words_of_materials(file)
    by_material = any(
        m.attrs.get("loss_factor") or _has_law(m, "table", "structural")
        for m in file.get("materials", {}).values()
    )
    springs = file.get("springs", {}).values()
    by_material |= any(
        spring.attrs.get("loss_factor") or _has_law(spring, "structural") for spring in springs
    )
    given = {k: float(file.attrs.get(k, 0)) for k in ("alpha", "beta", "eta")}
    dashpots = any("damping" in spring.attrs for spring in springs)
    relaxing = any(_has_law(of, "prony") for of in (*file.get("materials", {}).values(), *springs))
    further = ["relaxation of materials or springs (Prony terms)"] * relaxing
    return lines + damping_lines(given, by_material, dashpots, further, free > 0)


def _has_law(of: h5py.Group, *kinds: str) -> bool:
    """Whether a material, or a spring, has a law of these kinds, perhaps times a parameter."""
    laws = [part.attrs.get("law", "") for part in of.values() if isinstance(part, h5py.Group)]
    return any(str(law).removeprefix(PRODUCT) in kinds for law in laws)


def damping_lines(
    damping: Mapping[str, float],
    by_material: bool = False,
    dashpots: bool = False,
    further: Sequence[str] = (),
    is_free: bool = False,
) -> list[str]:
    """Damping in words, what a loss factor rules out, and what alpha does to a free body."""
    units = {"alpha": " 1/s", "beta": " s", "eta": ""}
    given = [f"{name} = {value:g}{units[name]}" for name, value in damping.items() if value]
    given += ["loss factors or tables of materials and springs"] * by_material
    given += ["dashpots"] * dashpots
    given += further
    lines = [f"damping: {', '.join(given)}" if given else "damping: none"]
    if not given:
        lines.append("note: without damping nothing is claimed near resonances: --zeta 1%,50,2000")
    if is_free and damping.get("alpha", 0) > 0:
        lines.append(
            f"note: alpha slows the rigid motion too, to 1/e in {1 / damping['alpha']:.3g} s. "
            "Floating frames (exudyn, sid, mbdyn) leave that out, and with it most of the damping "
            "of a mechanism whose parts move as wholes; --beta alone is the same everywhere. "
            "Frequency responses, couple, simulate, fmu and state-space hold it"
        )
    if damping.get("eta") or by_material:
        lines.append(
            "note: a loss factor exists in frequency only: simulate, state-space, fmu, exudyn, "
            "sid, simscape and other formats in time need alpha and beta instead (--zeta), or "
            "export --damping modal"
        )
    return lines
