"""What a page shows in space: the surface of a body, its interfaces, motions of it, stress."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexgram.basics import BodyError, Floats, Ints
from flexgram.model.geometry import Geometry

#: How a page looks at the body first: from where, the angle of view from below to above [degrees],
#: the share of the picture that the body fills, and up to which width over height it counts.
DIRECTION = (1.0, -1.4, 0.8)
ANGLE = 30
FILL = 0.85
ASPECT = 2.0
#: Colours of body and interfaces.
PLAIN = "#9ecae1"
MARKS = ("#d62728", "#ff7f0e", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#17becf")
#: Triangles that a page draws at most, and the bytes of its motions.
TRIANGLES = 40_000
BYTES = 1_600_000
#: The largest stress, as the page has it; one more is where none is known.
LARGEST_STRESS = 254


def packed(values: Any, kind: str) -> str:
    """Numbers as base64 of their bytes, little endian."""
    return base64.b64encode(np.ascontiguousarray(values).astype(f"<{kind}").tobytes()).decode()


def as_shorts(values: Floats) -> tuple[str, float]:
    """Numbers as 16-bit integers, and what one of these is worth."""
    unit = max(float(np.abs(values).max(initial=0.0)), 1e-300) / 32767
    return packed(np.round(values / unit), "i2"), unit


def simplified(points: Floats, triangles: Ints, most: int) -> tuple[Ints, Ints]:
    """Fewer triangles of a surface: nodes in one cell of a grid become one of them.

    Parameters
    ----------
    points : (N, 3) array
    triangles : (T, 3) int array
    most : int
        Triangles that may be left.

    Returns
    -------
    nodes : (n,) int array
        Those that are left, of ``points``.
    triangles : (t, 3) int array
        Of ``nodes``.

    Examples
    --------
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1e-3, 0, 0]])
    >>> simplified(points, np.array([[0, 1, 2], [3, 1, 2]]), 1)
    (array([0, 1, 2]), array([[0, 1, 2]]))
    """
    used, triangles = np.unique(triangles, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    if len(triangles) <= most:
        return used, triangles
    places = points[used] - points[used].min(axis=0)
    size = float(places.max())
    finest, coarsest = 1, 4096
    best = _clustered(places, triangles, size)
    while coarsest - finest > 1:  # cells along the longest side
        count = (finest + coarsest) // 2
        found = _clustered(places, triangles, size / count)
        if len(found[1]) <= most:
            finest, best = count, found
        else:
            coarsest = count
    return used[best[0]], best[1]


def _clustered(places: Floats, triangles: Ints, cell: float) -> tuple[Ints, Ints]:
    """The first node of each cell for all in it; triangles with three of them, each once."""
    cells = np.floor(places / cell).astype(np.int64)
    keys = cells @ np.array([1, 1 << 20, 1 << 40])
    _, first, of_node = np.unique(keys, return_index=True, return_inverse=True)
    t = of_node.ravel()[triangles]
    whole = (t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])
    t = t[whole]
    _, one = np.unique(np.sort(t, axis=1), axis=0, return_index=True)
    return first, t[np.sort(one)]


@dataclass
class Scene:
    """A body to be turned, and what it can do.

    Attributes
    ----------
    points : (n, 3) array
        Nodes that are drawn [m].
    triangles, lines : (t, 3), (l, 2) int arrays
        Of these.
    nodes : (n,) int array
        Which nodes of the geometry these are.
    interfaces, positions : dict
        Of interfaces and supports: name -> its nodes of the geometry, (k,), and where they are,
        (k, 3) [m].
    count : int
        Nodes of the geometry.
    whole : int
        Triangles before ``simplified``.
    motions : list of dict
        Names with displacements as the page wants them.
    """

    points: Floats
    triangles: Ints
    lines: Ints
    nodes: Ints
    interfaces: dict[str, Ints]
    positions: dict[str, Floats]
    count: int
    whole: int
    motions: list[dict[str, Any]] = field(default_factory=list)
    history: dict[str, Any] | None = None

    @classmethod
    def of(cls, geometry: Geometry) -> Scene:
        """The surface, shells and beams of a body.

        Raises
        ------
        BodyError
            For one without elements to draw.
        """
        triangles = geometry.surface()
        lines = [nodes for kind, nodes in geometry.blocks if kind.startswith("line")]
        beams: Ints = np.vstack([np.empty((0, 2), dtype=np.int64), *(b[:, :2] for b in lines)])
        if not len(triangles) and not len(beams):
            raise BodyError("the body has no elements to draw")
        kept, few = simplified(geometry.points, triangles, TRIANGLES)
        nodes = np.union1d(kept, beams)
        held = {f"support {name}": at for name, at in geometry.supports.items()}
        marked = {**geometry.interfaces, **held}
        return cls(
            geometry.points[nodes],
            np.searchsorted(nodes, kept[few]) if len(few) else np.empty((0, 3), dtype=np.int64),
            np.searchsorted(nodes, beams),
            nodes,
            marked,
            {name: geometry.points[at] for name, at in marked.items()},
            len(geometry.points),
            len(triangles),
        )

    @property
    def room(self) -> int:
        """How many motions a page has room for."""
        return max(1, BYTES // (6 * max(len(self.nodes), 1)))

    def add_motion(self, name: str, field_of_nodes: Floats) -> None:
        """A motion of all nodes of the geometry, (N, 3): the page chooses how large it is drawn."""
        values, unit = as_shorts(field_of_nodes[self.nodes])
        self.motions.append({"name": name, "values": values, "unit": unit})

    def set_history(
        self,
        times: Floats,
        motion: Floats,
        stress: Floats | None,
        count: int,
        most: float | None = None,
        name: str = "load history",
    ) -> None:
        """What the body does over time, at moments that a page can go through.

        Parameters
        ----------
        times : (k,) array
            [s]
        motion : (k, N, 3) array
            Of the nodes of the geometry [m].
        stress : (k, N) array, optional
            Von Mises [N/m²]; NaN where there is none.
        count : int
            Moments of the whole history.
        most : float, optional
            The largest stress of all of it, which the scale ends with; default: of the nodes drawn.
        name : str
            What the page calls it.
        """
        moved = motion[:, self.nodes]
        flat = moved.reshape(len(times), -1)
        U, s, V = np.linalg.svd(flat, full_matrices=False)
        rank = max(1, min(8, int((s > 1e-4 * s[0]).sum()))) if s[0] > 0 else 1
        shapes = [as_shorts(row.reshape(-1, 3)) for row in V[:rank]]
        self.history = {
            "name": name,
            "times": [float(t) for t in times],
            "weights": (U[:, :rank] * s[:rank]).tolist(),
            "shapes": [{"values": values, "unit": unit} for values, unit in shapes],
            "largest": float(np.linalg.norm(moved, axis=2).max()),
            "count": count,
        }
        sizes = np.linalg.norm(flat, axis=1)
        if stress is not None:
            known = np.isfinite(stress[:, self.nodes])
            of_nodes = np.where(known, stress[:, self.nodes], 0.0)
            most = max(float(of_nodes.max()), most or 0.0, 1e-300)
            levels = np.where(known, np.round(LARGEST_STRESS * of_nodes / most), LARGEST_STRESS + 1)
            self.history["stress"] = packed(levels, "u1")
            self.history["most"] = most
            sizes = of_nodes.max(axis=1)
        self.history["worst"] = int(np.argmax(sizes))

    def marked(self) -> dict[str, tuple[Ints, Floats]]:
        """Interfaces with some nodes, not all: which of the points these are, (k,), and where they
        are, (l, 3) [m]; no more than a picture needs."""
        place = {int(node): k for k, node in enumerate(self.nodes)}
        found = {}
        for name, nodes in self.interfaces.items():
            if not 0 < len(nodes) < self.count:
                continue
            drawn = np.array([place[int(n)] for n in nodes if int(n) in place], dtype=np.int64)
            at = self.points[drawn] if len(drawn) else self.positions[name]
            found[name] = (drawn[:: len(drawn) // 400 + 1], at[:: len(at) // 400 + 1])
        return found

    def data(self) -> dict[str, Any]:
        """For the page, as JSON."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        centre = 0.5 * (low + high)
        points, unit = as_shorts(self.points - centre)
        shown = {
            name: {
                "drawn": drawn.tolist(),
                "points": [] if len(drawn) else (at - centre).ravel().tolist(),
                "middle": (self.positions[name].mean(axis=0) - centre).tolist(),
            }
            for name, (drawn, at) in self.marked().items()
        }
        return {
            "points": points,
            "unit": unit,
            "size": float(np.linalg.norm(high - low)) or 1.0,
            "low": (low - centre).tolist(),
            "triangles": packed(self.triangles, "u4"),
            "lines": packed(self.lines, "u4"),
            "interfaces": shown,
            "look": {"from": DIRECTION, "angle": ANGLE, "fill": FILL, "aspect": ASPECT},
            "colours": {"plain": PLAIN, "marks": MARKS},
            "motions": self.motions,
            "history": self.history,
        }


def libraries(folder: Path = Path("/usr/share/javascript")) -> dict[str, str]:
    """The JavaScript that pages need, as Debian's packages libjs-three and libjs-dygraphs have it.

    Returns
    -------
    dict of str
        Name -> text; empty if one of them is missing.
    """
    files = {
        "three": "three/three.min.js",
        "controls": "three/examples/js/controls/OrbitControls.js",
        "dygraph": "dygraphs/dygraph.min.js",
        "synchronizer": "dygraphs/src-es5/extras/synchronizer.js",
        "dygraph_style": "dygraphs/dygraph.min.css",
    }
    if not all((folder / file).exists() for file in files.values()):
        return {}
    return {  # without the addresses of their sources
        name: re.sub(r"(//|/\*)# sourceMappingURL=\S+( \*/)?", "", (folder / file).read_text())
        for name, file in files.items()
    }
