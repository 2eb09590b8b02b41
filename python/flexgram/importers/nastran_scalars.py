"""Elements of Nastran bulk data that act on one number made of the dofs of several grids: shear
panels, and springs, dampers and masses whose ends lie apart or move in different components.

That number is the x of a node of its own, which follows the grids by an equation, and a spring or a
mass is there: K = k c cᵀ and M = m c cᵀ for the row c of the equation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import roots_legendre

from flexgram.basics import BodyError, Floats
from flexgram.importers.alone import COMPONENTS, Row
from flexgram.importers.nastran_deck import BulkDeck
from flexgram.importers.nastran_elements import Elements
from flexgram.importers.nastran_equations import Equations


class Scalars:
    """Nodes of such numbers, and what acts there."""

    def __init__(
        self,
        deck: BulkDeck,
        elements: Elements,
        equations: Equations,
        springs: dict[str, dict[str, Any]],
        masses: dict[str, dict[str, Any]],
    ) -> None:
        self.deck, self.elements, self.equations = deck, elements, equations
        self.springs, self.masses = springs, masses  #: to add to
        self.nodes: list[int] = []  #: from 1

    def add(
        self,
        name: str,
        terms: Row,
        place: Floats,
        *,
        stiffness: float = 0.0,
        damping: float = 0.0,
        loss: float = 0.0,
        mass: float = 0.0,
    ) -> None:
        """What acts on the sum of terms; under one name the same on several."""
        if not terms or not (stiffness or damping or mass):
            return
        self.elements.ends.append(np.asarray(place, dtype=float))
        node = len(self.deck.points) + len(self.elements.ends)
        self.nodes.append(node)
        equation: Row = [[node, "x", 1.0], *([n, c, -f] for n, c, f in terms)]
        self.equations.entries.setdefault(f"of_{name}", {"terms": []})["terms"].append(equation)
        if stiffness or damping:
            entry: dict[str, Any] = {"nodes": []}
            entry |= {"stiffness": [stiffness, 0, 0]} if stiffness else {}
            entry |= {"damping": [damping, 0, 0]} if damping else {}
            entry |= {"loss_factor": loss} if loss else {}
            self.springs.setdefault(name, entry)["nodes"].append(node)
        if mass:
            self.masses[name] = {"nodes": [node], "matrix": np.diag([mass, 0, 0, 0, 0, 0]).tolist()}

    def are_needed(self, ends: list[tuple[int, int]]) -> bool:
        """Whether a spring is no spring between two nodes in one place, or from one to ground."""
        if any(label in self.elements.scalars for label, _ in ends):
            return True
        if len(ends) < 2:
            return False
        a, b = (self.deck.points[self.deck.at(label)] for label, _ in ends)
        size = float(np.abs(self.deck.points).max())
        return ends[0][1] != ends[1][1] or float(np.linalg.norm(b - a)) > 1e-9 * size

    def between(self, ends: list[tuple[int, int]]) -> tuple[Row, Floats]:
        """Component (from 1) of the first grid less that of the second, if there is one; along the
        grids' own axes. The terms, and a place."""
        terms: Row = []
        for (label, component), sign in zip(ends, (1.0, -1.0), strict=False):
            terms += self.equations.row(label, component, sign)
        label = ends[0][0]
        scalar = self.elements.scalars.get(label)
        return terms, self.elements.point(self.deck.at(label) if scalar is None else scalar - 1)

    def bush(self, number: int, nodes: list[int], axes: Floats, of: dict[str, Any]) -> None:
        """A CBUSH between two grids of which one at least has no rotations: it acts midway, and
        these count as held, as AUTOSPC does.

        ``of``: (6,) arrays ``K`` and ``B`` along the axes (in rows), and ``losses``."""
        where = self.deck.points[[self.deck.at(n) for n in nodes]]
        middle = where.mean(axis=0)
        for c in range(6):
            k, b = float(of["K"][c]), float(of["B"][c])
            terms: Row = []
            for n, place, sign in zip(nodes, where, (-1.0, 1.0), strict=True):
                turns = n in self.elements.turning
                along, at = axes[c % 3], self.deck.at(n) + 1
                if c < 3:
                    terms += _along(at, 0, sign * along)
                if turns:  # e · (θ × d) = θ · (d × e)
                    about = along if c > 2 else np.cross(middle - place, along)
                    terms += _along(at, 3, sign * about)
            self.add(f"cbush{number}_{c + 1}", terms, middle, stiffness=k, damping=b,
                     loss=of["losses"][c])  # fmt: skip

    def panel(self, number: int, element: Any) -> None:
        """CSHEAR: shear flow along its edges alone, PSHEAR's rods along these, and its mass, a
        quarter at each grid."""
        prop = element.pid_ref
        if prop is None or prop.mid_ref is None or prop.mid_ref.type != "MAT1":
            raise self.deck.refuse("CSHEAR", number, "needs a PSHEAR with a MAT1")
        grids, t = [int(n) for n in element.node_ids], float(prop.t)
        x = self.deck.points[[self.deck.at(n) for n in grids]]
        G, nu, E = (float(v or 0.0) for v in (prop.mid_ref.g, prop.mid_ref.nu, prop.mid_ref.e))
        if not (G > 0 and t > 0):
            raise self.deck.refuse("CSHEAR", number, "its G and its thickness must be positive")
        try:
            forces, area, flexibility = panel_of(x, nu)
        except BodyError as error:
            raise self.deck.refuse("CSHEAR", number, str(error)) from None
        numbers = [self.deck.at(n) + 1 for n in grids]
        terms = [term for n, f in zip(numbers, forces, strict=True) for term in _along(n, 0, f)]
        scale = 1 / np.sqrt(flexibility)  # so that all panels of a property have one spring
        self.add(f"cshear_p{prop.pid}", [[n, c, f * scale] for n, c, f in terms], x.mean(axis=0),
                 stiffness=G * t, loss=float(prop.mid_ref.ge or 0.0))  # fmt: skip
        sides = np.linalg.norm(np.roll(x, -1, axis=0) - x, axis=1)
        for factor, pair in ((prop.f1, (0, 2)), (prop.f2, (1, 3))):
            full = 0.5 * t * t * factor
            section = full if factor > 1.01 else factor * t * area / sides[list(pair)].sum()
            for k in pair if section > 0 else ():
                self.springs[f"cshear{number}_{k + 1}"] = {
                    "nodes": [numbers[k]],
                    "to_nodes": [numbers[(k + 1) % 4]],
                    "stiffness": float(E * section / sides[k]),
                }
        rho, wtmass = float(prop.mid_ref.rho or 0.0), self.deck.param("WTMASS") or 1.0
        if mass := (rho * t + float(prop.nsm or 0.0)) * area * wtmass:
            self.masses[f"cshear{number}"] = {"nodes": numbers, "mass": mass / 4}


def _along(node: int, first: int, factors: Floats) -> Row:
    names = COMPONENTS[first : first + 3]
    return [[node, name, float(f)] for name, f in zip(names, factors, strict=True) if f]


def panel_of(x: Floats, nu: float) -> tuple[Floats, float, float]:
    """A panel that bears shear flow along its edges alone (Garvey, The quadrilateral shear panel,
    1951).

    Parameters
    ----------
    x : (4, 3) array
        Its corners, in order.
    nu : float
        Poisson's ratio.

    Returns
    -------
    forces : (4, 3) array
        At the corners, in equilibrium, of a mean flow of one.
    area : float
    flexibility : float
        Twice the energy of that flow is this over G t: the area of a rectangle.

    Raises
    ------
    BodyError
        If it is not convex.
    """
    normal = np.cross(x[2] - x[0], x[3] - x[1])
    area = float(np.linalg.norm(normal)) / 2
    if not area > 0:
        raise BodyError("it has no area")
    normal /= 2 * area
    first = x[1] - x[0] - normal * (normal @ (x[1] - x[0]))
    first /= np.linalg.norm(first)
    axes = np.array([first, np.cross(normal, first)])
    p = (x - x.mean(axis=0)) @ axes.T  # in its mean plane
    edges = np.roll(p, -1, axis=0) - p
    turns = [edges[k - 1, 0] * edges[k, 1] - edges[k - 1, 1] * edges[k, 0] for k in range(4)]
    if not min(turns) > 0:
        raise BodyError("it is not convex")
    # Flows along the edges in equilibrium: one state, whose signs alternate.
    balance = np.vstack([edges.T, p[:, 0] * edges[:, 1] - p[:, 1] * edges[:, 0]])
    flow = np.linalg.svd(balance / np.abs(balance).max(axis=1, keepdims=True))[2][-1]
    flow *= np.sign(flow[1]) / np.abs(flow).mean()
    each = 0.5 * flow[:, None] * edges @ axes  # at each end of an edge
    forces = each + np.roll(each, 1, axis=0)
    # Of a warped panel: without what rigid motions would feel.
    arms = x - x.mean(axis=0)
    rigid = np.vstack([np.kron(np.ones(4), e) for e in np.eye(3)]
                      + [np.cross(e, arms).ravel() for e in np.eye(3)])  # fmt: skip
    rest = forces.ravel()
    rest = rest - rigid.T @ np.linalg.lstsq(rigid @ rigid.T, rigid @ rest, rcond=None)[0]
    return rest.reshape(4, 3), area, _flexibility(p, flow, nu)


def _flexibility(p: Floats, flow: Floats, nu: float) -> float:
    """Twice the energy over G t of flows along the lines through the two points in which opposite
    edges meet; they fall with the square of the distance from the line through both points.

    Parameters
    ----------
    p : (4, 2) array
        Corners, counter-clockwise.
    flow : (4,) array
        Means along the edges.
    """
    scale = float(np.ptp(p))
    corners = np.column_stack([p / scale, np.ones(4)])
    edge = [np.cross(corners[k], corners[(k + 1) % 4]) for k in range(4)]
    meet = [np.cross(edge[0], edge[2]), np.cross(edge[1], edge[3])]  # at infinity, if parallel
    axis = np.cross(meet[0], meet[1])
    s, weights = roots_legendre(12)
    first = corners[0] + np.outer((1 + s) / 2, corners[1] - corners[0])
    mean = float(weights / 2 @ (first @ axis) ** -2.0)  # of the flow along the first edge
    total = 0.0
    for a, wa in zip(s, weights, strict=True):
        for b, wb in zip(s, weights, strict=True):
            N = 0.25 * np.array([(1 - a) * (1 - b), (1 + a) * (1 - b), (1 + a) * (1 + b),
                                 (1 - a) * (1 + b)])  # fmt: skip
            along = 0.25 * np.array([-(1 - b), 1 - b, 1 + b, -(1 + b)]) @ p
            across = 0.25 * np.array([-(1 - a), -(1 + a), 1 + a, 1 - a]) @ p
            here = N @ corners
            u, v = ((m[:2] - m[2] * here[:2]) for m in meet)
            tangent = float(u @ v) / (u[0] * v[1] - u[1] * v[0])  # of the angle beside 90°
            q = flow[0] * float(here @ axis) ** -2.0 / mean
            size = along[0] * across[1] - along[1] * across[0]
            total += wa * wb * size * q * q * (1 + 2 * tangent**2 / (1 + nu))
    return total
