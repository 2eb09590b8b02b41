"""A body that turns at a speed known between two numbers, as its description gives it."""

from __future__ import annotations

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.reader import Reader, short

KEYS = ("axis", "point", "from", "to", "rpm", "frame")
FRAMES = ("turning", "rest")


def unit_axis(entry: Reader) -> Floats:
    """The vector ``axis``, of length 1.

    Raises
    ------
    BodyError
        If it has no direction.
    """
    axis = entry.vector("axis")
    length = np.linalg.norm(axis)
    if not length > 0:
        raise BodyError(f"{entry.where}: axis = [0, 0, 0] has no direction")
    direction: Floats = axis / length
    return direction


def _speeds(entry: Reader) -> tuple[float, float]:
    """The least and the most [rad/s]."""
    if "rpm" not in entry.data:
        return entry.number("from", 0.0), entry.number("to")
    if "from" in entry.data or "to" in entry.data:
        raise BodyError(f"{entry.where}: give from and to in rad/s, or rpm, not both")
    given = entry.get("rpm")
    try:
        least, most = (float(speed) * 2 * np.pi / 60 for speed in given)
    except (TypeError, ValueError):
        raise BodyError(f"{entry.where}: rpm = {short(given)} must be [from, to]") from None
    return least, most


def write_spin(file: h5py.File, reader: Reader, length: float) -> None:
    """Write what the description says of it.

    Parameters
    ----------
    file : h5py.File
    reader : Reader
        Of the whole description, perhaps with the key ``spin``: a mapping of ``axis`` (a vector),
        ``point`` (on the axis, in the unit of length; default the origin), ``from`` (default 0) and
        ``to`` [rad/s], or ``rpm``: [from, to]; ``frame``: turning (default) or rest.
    length : float
        Unit of length [m].

    Raises
    ------
    BodyError
        Naming the place of the mistake.
    """
    if "spin" not in reader.data:
        return
    entry = Reader(reader.get("spin"), "spin", KEYS)
    least, most = _speeds(entry)
    if not (np.isfinite(least) and np.isfinite(most) and 0 <= least < most):
        raise BodyError(f"spin: speeds must rise from 0 or more, not {least:g} to {most:g} rad/s")
    group = file.create_group("spin")
    group.attrs["frame"] = entry.choice("frame", FRAMES, "turning")
    group.attrs["axis"] = unit_axis(entry)
    group.attrs["point"] = length * (
        entry.vector("point") if "point" in entry.data else np.zeros(3)
    )
    for name, value in (("least", least), ("most", most), ("value", most)):
        group.attrs[name] = value
