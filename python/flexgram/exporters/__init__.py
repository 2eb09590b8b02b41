"""Reduced bodies for multibody codes and other tools; ``export`` chooses by name.

May import: basics, body, model.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexgram.basics import BodyError, expect_kept
from flexgram.body.laws import Circulatory
from flexgram.model.reduced import ReducedBody

__all__ = ["FORMATS", "export"]


def _exudyn(model: ReducedBody, path: Path, **options: Any) -> None:
    from flexgram.exporters.exudyn import write_npz

    write_npz(model, path, **options)


def _sid(model: ReducedBody, path: Path, **options: Any) -> None:
    from flexgram.exporters.sid import write_sid

    options.pop("body", None)
    write_sid(model, path, **options)


def _dmig(model: ReducedBody, path: Path, **_: Any) -> None:
    from flexgram.exporters.dmig import write_dmig

    write_dmig(model, path)


def _superelement(writer: str) -> Callable[..., None]:
    def write(model: ReducedBody, path: Path, **options: Any) -> None:
        from flexgram.exporters import superelements

        getattr(superelements, writer)(model, path, **options)

    return write


def _mat(model: ReducedBody, path: Path, **_: Any) -> None:
    from flexgram.exporters.arrays import write_mat

    write_mat(model, path)


def _npz(model: ReducedBody, path: Path, **_: Any) -> None:
    from flexgram.exporters.arrays import write_npz

    write_npz(model, path)


def _mbdyn(model: ReducedBody, path: Path, **options: Any) -> None:
    from flexgram.exporters.mbdyn import write_mbdyn

    write_mbdyn(model, path, **options)


def _octave(model: ReducedBody, path: Path, **options: Any) -> None:
    from flexgram.exporters.octave import write_octave

    write_octave(model, path, **options)


def _state_space(model: ReducedBody, path: Path, **options: Any) -> None:
    from flexgram.exporters.arrays import write_state_space

    write_state_space(model, path, **options)


def _fmu(version: int) -> Callable[..., None]:
    def write(model: ReducedBody, path: Path, **options: Any) -> None:
        from flexgram.exporters.fmi import write_fmu

        write_fmu(model, path, version, **options)

    return write


def _shapes(model: ReducedBody, path: Path, **options: Any) -> None:
    from flexgram.exporters.shapes import write_shapes

    write_shapes(model, path, **options)


#: name: what, suffix, writer
FORMATS: dict[str, tuple[str, str, Callable[..., None]]] = {
    "exudyn": ("NPZ for EXUDYN's ObjectFFRFreducedOrder", ".npz", _exudyn),
    "sid": ("standard input data of a flexible body (SID_FEM)", ".SID_FEM", _sid),
    "dmig": ("Nastran DMIG: stiffness, mass, damping, loads", ".pch", _dmig),
    "nastran": (
        "Nastran superelement: GRIDs at the interfaces, SPOINTs, KAAX, MAAX, BAAX",
        ".bdf",
        _superelement("write_nastran"),
    ),
    "op4": (
        "KAA, MAA, BAA, PA: motions of the interfaces, then modes",
        ".op4",
        _superelement("write_op4"),
    ),
    "abaqus": (
        "Abaqus: nodes at the interfaces, *MATRIX INPUT of stiffness, mass and damping",
        ".inp",
        _superelement("write_abaqus"),
    ),
    "simscape": (
        "Simscape Multibody, block Reduced Order Flexible Solid",
        ".mat",
        _superelement("write_simscape"),
    ),
    "extptfm": ("OpenFAST's ExtPtfm (Flex 5 format)", ".dat", _superelement("write_extptfm")),
    "mbdyn": ("data file of MBDyn's modal joint", ".fem", _mbdyn),
    "fmu": ("functional mock-up unit, FMI 2.0", ".fmu", _fmu(2)),
    "fmu3": ("functional mock-up unit, FMI 3.0", ".fmu", _fmu(3)),
    "mat": ("MATLAB", ".mat", _mat),
    "octave": (
        "script for MATLAB and Octave with its data: loads the body, draws H, simulates",
        ".m",
        _octave,
    ),
    "npz": ("NumPy", ".npz", _npz),
    "state-space": ("A, B, C, D of x' = A x + B u as MATLAB or NumPy file", ".mat", _state_space),
    "vtu": ("basis vectors on the mesh for ParaView (any meshio format)", ".vtu", _shapes),
}


#: Endings of formats that have several; none: any that meshio writes.
ENDINGS: dict[str, tuple[str, ...]] = {"state-space": (".mat", ".npz"), "vtu": ()}


#: Formats that hold parameters of the body as what they are.
WITH_PARAMETERS = ("fmu", "fmu3")
#: Formats that hold circulatory forces.
WITH_CIRCULATION = ("mat", "npz", "octave", "state-space", "vtu")


def keeps_parameters(model: ReducedBody, format: str) -> bool:
    """Whether the format holds parameters of the body as what they are."""
    return format in WITH_PARAMETERS and bool(model.system.parameters)


def export(model: ReducedBody, path: str | Path, format: str, **options: Any) -> Path:
    """Write a reduced body for another program.

    Parameters
    ----------
    model : ReducedBody
        The body.
    path : str or Path
        File to write.
    format : str
        One of ``FORMATS``.
    **options
        ``dialect`` for ``sid``; ``body`` (body file, for the mesh) and ``stress`` (bool: stresses
        come along) for ``exudyn`` and ``vtu``; ``body`` for superelements, where interfaces are;
        ``rates`` for ``state-space`` and ``fmu``.

    Returns
    -------
    Path
        The file: ``path``, with the format's ending if it has none.

    Raises
    ------
    BodyError
        If the body lacks what the format needs, with the remedy.

    Examples
    --------
    >>> rom = flexgram.ReducedModel.load("rack.rom.h5")
    >>> flexgram.export(rom, "rack.SID_FEM", "sid").name
    'rack.SID_FEM'
    >>> flexgram.export(rom, "rack", "mat").name
    'rack.mat'
    """
    if format not in FORMATS:
        raise BodyError(f"export to {format}: must be one of {', '.join(FORMATS)}")
    target = target_of(path, format)
    if model.path is not None:
        body = model.provenance.body
        beside = [model.path.parent / body, Path(body)] if body else []
        expect_kept(target, model.path, options.get("body"), *beside)
    circulates = any(isinstance(term.law, Circulatory) for term in model.system.at().terms)
    if circulates and format not in WITH_CIRCULATION:
        raise BodyError(
            f"export to {format}: it has no place for circulatory forces (a stiffness that is not "
            f"symmetric); {', '.join(WITH_CIRCULATION)} have one"
        )
    if not keeps_parameters(model, format):
        model = model.at()  # with their present values
    FORMATS[format][2](model, target, **{k: v for k, v in options.items() if v is not None})
    return target


def target_of(path: str | Path, format: str) -> Path:
    """The file that an export writes: with the format's ending, if ``path`` has none.

    Raises
    ------
    BodyError
        If ``path`` has the ending of another format.
    """
    target, own = Path(path), FORMATS[format][1]
    if not target.suffix and not target.exists():
        return target.with_name(target.name + own)
    ending, known = target.suffix.lower(), ENDINGS.get(format, (own,))
    others = {suffix for _, suffix, _ in FORMATS.values()} | {".h5", ".txt"}
    if known and ending not in {k.lower() for k in known} and ending in {o.lower() for o in others}:
        raise BodyError(f"{path}: --to {format} writes {' or '.join(known)}")
    return target
