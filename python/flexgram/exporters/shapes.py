"""Basis vectors and lifted deformations on the mesh, for ParaView."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np

from flexgram.basics import BodyError, written_aside
from flexgram.body.stress import von_mises
from flexgram.model.geometry import Geometry, body_of
from flexgram.model.recovery import sides_of, stress_at_nodes
from flexgram.model.reduced import ReducedBody


def _geometry(model: ReducedBody, body: str | Path | None) -> Geometry:
    return Geometry.load(body_of(model, body))


@contextmanager
def _with_data_of_its_own(place: Path) -> Iterator[Path]:
    """A name under which meshio writes XDMF so that its data are in ``rack.xdmf.h5``, not in
    ``rack.h5``, which may be the body. Other formats are one file."""
    if not _is_xdmf(place):
        yield place
        return
    name = place.with_name(f"{place.name}.xdmf")
    yield name
    name.rename(place)


def _is_xdmf(path: Path) -> bool:
    return path.suffix.lower() in (".xdmf", ".xmf")


def _companions(path: Path) -> list[str]:
    """XDMF's data, which ``_expect_such_data`` has looked at."""
    return [f"{path.name}.h5"] if _is_xdmf(path) else []


def _expect_such_data(path: Path) -> None:
    """Refuse to replace a ``rack.xdmf.h5`` that holds anything else than XDMF's data."""
    data = path.with_name(path.name + ".h5")
    if not _is_xdmf(path) or not data.exists():
        return
    try:
        with h5py.File(data) as file:
            theirs = [name for name in file if not re.fullmatch(r"data\d+", name)]
    except OSError:
        theirs = ["no HDF5"]
    if theirs:
        raise BodyError(f"{data} is there, and holds no data of {path.name}: another name")


def write_shapes(
    model: ReducedBody, path: Path, body: str | Path | None = None, stress: bool = False
) -> None:
    """Every basis vector as a vector field ``phi_001``, … on the body's mesh, with its ``stress``
    ``sigma_001``, … (xx, yy, zz, xy, yz, zx) if asked, of shells ``sigma_top_001``, … and
    ``sigma_bottom_001``, ….

    The format is by the suffix, any that meshio writes.

    Examples
    --------
    >>> write_shapes(flexgram.ReducedModel.load("rack.rom.h5"), Path("rack.vtu"))
    """
    geometry = _geometry(model, body)
    fields = {f"phi_{j + 1:03d}": field for j, field in enumerate(geometry.motion(model))}
    if stress:
        for side in sides_of(model, body):
            stresses = enumerate(stress_at_nodes(model, body=body, side=side), 1)
            sigma = f"sigma_{side}" if side else "sigma"
            fields |= {f"{sigma}_{j:03d}": field for j, field in stresses}
    mesh = meshio.Mesh(geometry.points, geometry.blocks, point_data=fields)
    try:
        _expect_such_data(Path(path))
        with written_aside(path, body, model.path, companions=_companions(path)) as place:
            with _with_data_of_its_own(place) as name:
                meshio.write(name, mesh)
    except (meshio.WriteError, meshio.ReadError, KeyError, TypeError, ImportError) as error:
        raise BodyError(
            f"{path}: meshio cannot write it ({error}); .vtu and .xdmf it can"
        ) from error


def numbers_of_motion(
    model: ReducedBody, body: str | Path | None = None, stress: bool = False
) -> int:
    """How many numbers ``write_motion`` writes of a moment.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> numbers_of_motion(rom) % 3, numbers_of_motion(rom, stress=True) > 3 * numbers_of_motion(rom)
    (0, True)
    """
    per_node = 3 + (1 + 6 * len(sides_of(model, body)) if stress else 0)
    return per_node * len(Geometry.load(body_of(model, body)).points)


def write_motion(
    model: ReducedBody,
    path: str | Path,
    t: Any,
    q: Any,
    body: str | Path | None = None,
    stress: bool = False,
    u: Any = None,
    frames: int | None = None,
    tell: Callable[[str], None] | None = None,
) -> int:
    """Deformation over time as XDMF for ParaView; returns how many moments it holds.

    Parameters
    ----------
    model : ReducedBody
        The body.
    path : str or Path
        ``.xdmf`` file; its data go beside it, into ``NAME.xdmf.h5``.
    t, q : (n_t,), (n_t, m) arrays
        Times [s] and generalised coordinates, as ``simulate`` gives them.
    body : str or Path, optional
        Body file with the mesh; default: the one that was reduced.
    stress : bool
        Write ``stress`` (xx, yy, zz, xy, yz, zx), of shells ``stress_top`` and ``stress_bottom``,
        and ``von_mises`` [N/m²] too, of shells the larger of both sides.
    u : (n_t, n_in) array, optional
        Inputs; needed for the stress of a body that a temperature strains.
    frames : int, optional
        So many moments, evenly chosen, the first and the last among them; default: all.
    tell : callable, optional
        Told every few seconds how many are written.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("standing.rom.h5")
    >>> t = np.linspace(0, 0.1, 11)
    >>> _, q = rom.simulate(np.ones((11, len(rom.inputs))), t)
    >>> write_motion(rom, "standing.xdmf", t, q, frames=5)
    5
    """
    if not _is_xdmf(Path(path)):
        raise BodyError(f"{path}: a motion is written as XDMF: name it {Path(path).stem}.xdmf")
    where = Path(body_of(model, body)).resolve()  # meshio works in another folder
    geometry = Geometry.load(where)
    sides = sides_of(model, where) if stress else []
    chosen = np.arange(len(q))
    if frames is not None and frames < len(q):
        chosen = np.unique(np.linspace(0, len(q) - 1, max(frames, 2)).round().astype(int))
    t, q = np.asarray(t)[chosen], np.asarray(q)[chosen]
    loads = [None] * len(q) if u is None else np.asarray(u)[chosen]
    here = os.getcwd()
    _expect_such_data(Path(path))
    with (
        written_aside(path, body, model.path, companions=_companions(Path(path))) as place,
        _with_data_of_its_own(place) as name,
    ):
        os.chdir(name.parent)  # meshio puts the data file where it runs
        try:
            with meshio.xdmf.TimeSeriesWriter(name.name) as writer:
                writer.write_points_cells(geometry.points, geometry.blocks)
                begin = last = time.monotonic()
                for k, (moment, state, load) in enumerate(zip(t, q, loads, strict=True)):
                    now = time.monotonic()
                    if tell is not None and k > 0 and now - last > 3:
                        last = now
                        left = (len(q) - k) * (now - begin) / k
                        tell(f"{k} of {len(q)} moments, some {left:.0f} s left")
                    field = geometry.motion(model, state)[0]
                    data = {"u": field}
                    if stress:
                        for side in sides:
                            field = stress_at_nodes(model, state, where, load, side)[0]
                            data[f"stress_{side}" if side else "stress"] = field
                        largest = stress_at_nodes(model, state, where, load, "larger")[0]
                        data["von_mises"] = von_mises(largest)
                    writer.write_data(float(moment), point_data=data)
        finally:
            os.chdir(here)
    return len(q)
