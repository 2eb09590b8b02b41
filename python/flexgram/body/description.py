"""Body descriptions in YAML: mesh, materials by region, interfaces, supports, damping.

``meshes/rack.yaml`` is the example. ``import_body`` turns a description into a body file that
the program ``flexgram`` assembles.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import meshio
import yaml

from flexgram.basics import BodyError, ReductionWarning, errors_of, expect_kept
from flexgram.body.bodyfile import written_whole
from flexgram.body.mesh_body import MeshBody
from flexgram.body.meshfile import cell_regions, data_files, read_mesh
from flexgram.body.reader import Reader, UniqueKeys
from flexgram.body.units import UNITS


def import_body(description: str | Path, output: str | Path) -> dict[str, Any]:
    """Turn a YAML body description and its mesh into a body file.

    Parameters
    ----------
    description : str or Path
        YAML file; paths in it are relative to it.
    output : str or Path
        Body file to write (HDF5, SI units).

    Returns
    -------
    dict
        ``points`` and ``elements`` (counts), ``interfaces`` (for each name its coupling, number of
        nodes, reference position [m], what that is, and its distance from the middle of the
        interface in extents of that), ``loads`` and ``outputs`` (what each is), ``extent`` (of
        the body, 3 [m]), ``units``, ``summary`` (lines: mass, centre and inertia, free motions,
        materials, damping), ``warnings`` (Python's ``ReductionWarning`` too).

    Raises
    ------
    BodyError
        With the place in the description and what was expected.

    Examples
    --------
    >>> counts = flexgram.import_body("rack.yaml", "imported.h5")
    >>> counts["elements"], sorted(counts["interfaces"])
    (266, ['lower', 'upper'])
    """
    path = Path(description)
    try:
        content = yaml.load(path.read_text(), UniqueKeys)
    except UnicodeDecodeError:
        raise BodyError(f"{path}: not a text file; describe the mesh in YAML") from None
    except OSError as error:
        raise BodyError(f"{path}: {error.strerror}") from None
    except yaml.YAMLError as error:
        if path.suffix.lower() not in (".yaml", ".yml"):
            raise BodyError(
                f"{path}: not a description in YAML; flexgram.import_mesh takes a mesh, and "
                "flexgram.import_deck a deck with its materials"
            ) from None
        raise BodyError(f"{path}: not YAML: {error}") from None
    if not isinstance(content, dict):
        raise BodyError(
            f"{path}: not a body description; if it is a mesh, name it in a YAML file such as "
            "meshes/rack.yaml, or say what it is made of (flexgram import --material, in Python "
            "flexgram.import_mesh)"
        )
    with errors_of(path):
        return import_description(content, path.name, output, folder=path.parent, inputs=(path,))


def import_description(
    content: dict[str, Any],
    where: str,
    output: str | Path,
    *,
    folder: Path = Path(),
    inputs: Sequence[Path] = (),
    mesh: meshio.Mesh | None = None,
) -> dict[str, Any]:
    """Turn a description that is read already into a body file; as ``import_body``.

    Parameters
    ----------
    content : dict
        What the YAML file would hold.
    where : str
        For messages.
    output : str or Path
        Body file to write.
    folder : Path
        Which paths in the description are relative to.
    inputs : sequence of Path
        Files that the output must not replace, beside the mesh.
    mesh : meshio.Mesh, optional
        Instead of the file that the description names.

    Examples
    --------
    >>> content = {
    ...     "mesh": "rack.msh",
    ...     "materials": {"alloy": {"E": 70e9, "nu": 0.33, "rho": 2700}},
    ...     "regions": {"all": {"material": "alloy"}},
    ...     "interfaces": {"upper": {"coupling": "rigid", "nodes": "upper_plate"}},
    ... }
    >>> import_description(content, "the example", "alloy.h5")["elements"]
    266
    """
    reader = Reader(
        content,
        where,
        (
            "name",
            "mesh",
            "units",
            "materials",
            "regions",
            "sections",
            "interfaces",
            "supports",
            "nodes_alone",
            "equations",
            "ties",
            "masses",
            "springs",
            "loads",
            "outputs",
            "preload",
            "spin",
            "damping",
            "mass_integration",
            "merge",
            "repeated_elements",
        ),
    )
    units = UNITS[reader.choice("units", UNITS, "SI")]
    source = Path(where) if mesh is not None else folder / str(reader.get("mesh"))
    expect_kept(output, *inputs, source, *data_files(source))
    mesh = mesh if mesh is not None else read_mesh(source)
    with errors_of(source):
        cells = cell_regions(mesh)
    with written_whole(output) as file:
        facts = MeshBody(file, reader, mesh, cells, units, folder).write()
    for doubt in facts["warnings"]:
        warnings.warn(f"{output}: {doubt}", ReductionWarning, stacklevel=2)
    return facts
