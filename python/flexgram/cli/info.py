"""What a file of flexgram holds, in a few lines."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from flexgram.basics import BodyError, errors_of, expect_survival
from flexgram.body.terms import law_of
from flexgram.body.whole import summary
from flexgram.model.damped_modes import natural_frequencies
from flexgram.reduced_model import ReducedModel


def describe(path: str | Path) -> list[str]:
    """Lines about a body of matrices, a mesh body, a reduced file or a sweep file.

    Raises
    ------
    BodyError
        If it is none of them.
    """
    path = Path(path)
    if not path.exists():
        raise BodyError(f"{path}: no such file")
    if not h5py.is_hdf5(path):
        raise BodyError(f"{path}: not an HDF5 file")
    file = Path(path)
    expect_survival(file, lambda: _describe(file))
    with errors_of(path):
        return _describe(file)


def _describe(path: Path) -> list[str]:
    with h5py.File(path) as file:
        if "mesh" in file:
            return _mesh(file)
        if "gramian" not in file and "K" in file:
            return _matrices(file)
        if "H" in file and "omega" in file:
            hz = file["omega"][:] / (2 * np.pi)
            lines = [
                f"sweep of {len(hz)} frequencies, {hz[0]:g} to {hz[-1]:g} Hz, "
                f"{file['H'].shape[1]} outputs, {file['H'].shape[2]} inputs"
            ]
            if "error" in file:
                lines.append(
                    f"reduced body beside it: error at most {file['error/relative'][:].max():.1e}"
                )
            return lines
        if "gramian" not in file:
            if "levels" in file.attrs:
                raise BodyError(f"{path}: a medium model; flexgram cut takes it")
            raise BodyError(f"{path}: neither a body, a reduced nor a sweep file of flexgram")
    model = ReducedModel.load(path, basis=False)
    claim = model.claim
    hz = claim.bands / (2 * np.pi)
    bands = ", ".join(f"{first:g} to {last:g}" for first, last in hz)
    lines = [
        f"reduced body of order {model.order} by {model.provenance.stages}",
        f"band {bands} Hz, {claim.words}",
        f"inputs: {', '.join(model.inputs)}",
    ]
    if len(claim.field_error):
        lines.insert(
            2,
            "field, by its strain energy: "
            + ", ".join(
                f"{error:.1e} from {inputs}"
                for inputs, error in zip(claim.field_inputs, claim.field_error, strict=True)
            ),
        )
    if len(claim.kind_tolerances):
        lines.insert(
            2,
            "by kind: "
            + ", ".join(
                f"{kind} {error:.1e} of {asked:g}"
                for kind, error, asked in zip(
                    claim.kinds, claim.by_kind, claim.kind_tolerances, strict=True
                )
            ),
        )
    for said in (claim.words_of_data, claim.shortfall):
        if said:
            lines.insert(2, said)
    if model.outputs != model.inputs:
        lines.append(f"outputs: {', '.join(model.outputs)}")
    frame = model.frame
    lines.append(
        f"frame: {frame.kind}, {frame.rigid_modes} rigid modes"
        + (f", mass {frame.integrals.mass:.6g} kg" if frame.integrals else "")
        + (", geometric stiffening" if frame.integrals and frame.integrals.stiffening else "")
    )
    gyroscopic = model.system.is_gyroscopic
    elastic = natural_frequencies(model) if gyroscopic else model.elastic_frequencies
    first = ", ".join(f"{w / (2 * np.pi):.5g}" for w in elastic[:6])
    words = "poles, with gyroscopic or circulatory forces" if gyroscopic else "elastic modes"
    lines.append(f"{words} [Hz]: {first}{' …' if len(elastic) > 6 else ''}")
    lines += claim.words_of_held
    lines.append(f"from {model.provenance.body or 'an unknown body'}")
    lines += [f"warning: {text}" for text in model.provenance.warnings]
    return lines


def _mesh(file: h5py.File) -> list[str]:
    blocks = [(str(b.attrs["type"]), len(b["connectivity"])) for b in file["mesh/blocks"].values()]
    lines = [
        f"mesh of {len(file['mesh/points'])} points: "
        + ", ".join(f"{count} {kind}" for kind, count in blocks)
    ]
    for name, item in file.get("interfaces", {}).items():
        lines.append(f"interface {name}: {item.attrs['coupling']}, {len(item['nodes'])} nodes")
    for kind in ("loads", "outputs", "supports"):
        names = list(file.get(kind, {}))
        if names:
            lines.append(f"{kind}: {', '.join(names)}")
    return lines + summary(file)


def _matrices(file: h5py.File) -> list[str]:
    def shape(name: str) -> str:
        item = file[name]
        if isinstance(item, h5py.Group):
            return f"{int(item.attrs['MATLAB_sparse'])} rows, {len(item['data'])} nonzeros"
        return " × ".join(str(x) for x in item.shape)

    lines = [f"body of matrices: {', '.join(f'{n}: {shape(n)}' for n in 'KMDSBC' if n in file)}"]
    for name, term in file.get("terms", {}).items():
        law = law_of(str(term.attrs.get("law")), term.attrs, f"/terms/{name}")
        lines.append(f"term {name}: {shape(f'terms/{name}')}, {law.words}")
    names = file["B"].attrs.get("names") if "B" in file else None
    if names is not None:
        lines.append(f"inputs: {', '.join(str(n) for n in names)}")
    damping = [
        f"{n} = {float(file.attrs[n]):g}" for n in ("alpha", "beta", "eta") if file.attrs.get(n)
    ]
    if damping:
        lines.append(f"damping: {', '.join(damping)}")
    if "nodes/position" in file:
        lines.append(f"{len(file['nodes/position'])} nodes with coordinates")
    return lines
