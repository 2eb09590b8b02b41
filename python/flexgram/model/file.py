"""The reduced file as fields by their paths, for ``ReducedBody``."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, stored, written_aside


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        return [v.decode() if isinstance(v, bytes) else v for v in value]
    return value


def read_fields(path: Path, basis: bool) -> dict[str, Any]:
    """Datasets and attributes of a reduced file by their paths."""
    fields: dict[str, Any] = {}
    with h5py.File(path) as file:
        if any(name not in file for name in ("gramian", "K", "M", "D", "B", "C", "error")):
            raise BodyError(f"{path}: no reduced file (flexgram reduce writes one)")

        def collect(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and (basis or name != "V"):
                fields[name] = stored(path, item)
            values = {key: _plain(value) for key, value in item.attrs.items()}
            if name in ("log/seconds", "log/options", "log/versions"):
                fields[name] = values
            else:
                fields.update({f"{name}/{key}": value for key, value in values.items()})

        file.visititems(collect)
        fields.update({key: _plain(value) for key, value in file.attrs.items()})
        if "dofs/node" in fields:
            at = fields["dofs/node"]
            fields["dofs/position"] = fields["nodes/position"][at]
            fields["dofs/node"] = fields["nodes/id"][at]
    return fields


def port_names(fields: dict[str, Any], name: str, count: int) -> list[str]:
    """Names of the ports of B or C; without names, their numbers."""
    return [str(x) for x in fields.get(f"{name}/names", range(1, count + 1))]


def copy_file(source: Path, target: Path) -> None:
    """Copy a reduced file, whole or not at all."""
    if source.resolve() != target.resolve():
        with written_aside(target) as place:
            shutil.copyfile(source, place)
