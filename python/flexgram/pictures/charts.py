"""What a page draws over frequency: responses between ports, and the error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.model.reduced import ReducedBody
from flexgram.pictures.figures import HZ, envelope, expect_ports, read_sweep, unit_of
from flexgram.pictures.scene import packed

#: Numbers that responses of a page hold at most.
NUMBERS = 300_000
#: Frequencies of the reduced body, beside those near its poles.
POINTS = 500


def frequencies(model: ReducedBody) -> Floats:
    """Frequencies [rad/s] over all bands, and closer ones around lightly damped poles."""
    first, last = model.claim.bands[0, 0], model.claim.bands[-1, 1]
    if first == last:
        return np.array([first])
    low = np.geomspace(max(first, 1e-3 * last), last, POINTS // 2)  # for a logarithmic axis
    even: Floats = np.union1d(np.linspace(first, last, POINTS), low)
    try:
        poles = model.system.in_time().poles()
    except BodyError:  # those of loss factors
        return even
    inside = poles[(poles.imag > first) & (poles.imag < last)]
    sharp = inside[np.argsort(np.abs(inside.real))][:60]
    widths = np.maximum(np.abs(sharp.real), 1e-4 * sharp.imag)  # never at an undamped pole itself
    near = sharp.imag[:, None] + widths[:, None] * np.array([-4, -1.5, 0.01, 1.5, 4])
    near = near[(near > first) & (near < last)]
    found: Floats = np.unique(np.concatenate([even, near]))
    return found


def responses(
    model: ReducedBody, sweep: Path | None = None, ports: list[tuple[str, str]] | None = None
) -> dict[str, Any]:
    """|H| of the reduced body, and of a sweep, for as many pairs of ports as a page has room for:
    those that are asked for, then collocated ones, then the strongest.

    Returns
    -------
    dict
        As ``page/charts.js`` reads it.
    """
    omega = frequencies(model)
    whole = None
    if sweep is not None:
        whole = read_sweep(sweep, model)
        inside = (whole[0] >= omega[0]) & (whole[0] <= omega[-1])
        omega = np.union1d(omega, whole[0][inside])  # to be compared at each of them
    H = np.nan_to_num(np.abs(model.system.transfer(omega)), posinf=0.0)
    outputs, inputs = model.outputs, model.inputs
    expect_ports(model, ports or [])
    wanted = [(outputs.index(output), inputs.index(port)) for output, port in ports or []]
    same = [(outputs.index(name), j) for j, name in enumerate(inputs) if name in outputs]
    is_force = [name.rpartition(".")[2].startswith("f") for name in inputs]
    same.sort(key=lambda pair: (not is_force[pair[1]], -H[:, pair[0], pair[1]].max()))
    size = H.max(axis=0)
    strongest = [divmod(int(k), len(inputs)) for k in np.argsort(-size, axis=None)]
    box = None
    if model.system.parameters:
        box = envelope(model, omega)
    each = len(omega) * (3 if box else 1) + (len(whole[0]) if whole else 0)
    pairs = list(dict.fromkeys([*wanted, *same, *strongest]))[: max(1, NUMBERS // each)]
    i, j = np.array(pairs).T

    def curves(of: Floats) -> str:
        return packed(of[:, i, j].T, "f4")

    found: dict[str, Any] = {
        "hz": (omega * HZ).tolist(),
        "pairs": [
            {"output": outputs[a], "input": inputs[b], "unit": unit_of(outputs[a], inputs[b])}
            for a, b in pairs
        ],
        "left_out": len(outputs) * len(inputs) - len(pairs),
        "reduced": curves(H),
        "full": curves(np.abs(whole[1])) if whole else None,
        "full_hz": (whole[0] * HZ).tolist() if whole else [],
        "least": curves(box[0]) if box else None,
        "most": curves(box[1]) if box else None,
        "bands": (model.claim.bands * HZ).tolist() if np.isfinite(model.claim.supremum) else [],
        "excluded": (model.claim.excluded * HZ).tolist(),
        "from": float(model.claim.bands[0, 0] * HZ) * (0.95 if len(omega) == 1 else 1),
        "to": float(model.claim.bands[-1, 1] * HZ) * (1.05 if len(omega) == 1 else 1),
        "error": errors(model),
    }
    return found


def errors(model: ReducedBody) -> dict[str, Any]:
    """The bound of the error, the error where it is known, and the tolerance."""
    claim = model.claim
    columns: dict[str, tuple[Floats, dict[str, Any]]] = {}
    if len(claim.bound):
        word = "certified" if claim.kind.startswith("certified") else "estimated"
        columns[f"{word} bound"] = (claim.bound, {"color": "#e08214", "strokeWidth": 3})
    if not np.array_equal(claim.error, claim.bound):  # of some assemblies the bound alone is known
        columns[model.provenance.words_of_curve] = (claim.error, {"color": "#0868ac"})
    if claim.tolerance:
        constant = np.full(len(claim.omega), float(claim.tolerance))
        columns["tolerance"] = (constant, {"color": "#c0392b", "strokePattern": [8, 4]})
    for name, values, dashes in (
        ("rounding in it", claim.floor, [2, 3]),
        ("digits of K, beside it", claim.data_rounding, [10, 3, 2, 3]),
    ):
        if len(values) == len(claim.omega) and np.any(values > 0):
            columns[name] = (values, {"color": "#7a6a55", "strokePattern": dashes})
    columns = {name: of for name, of in columns.items() if np.isfinite(of[0]).any()}
    if not len(claim.bound):  # samples, between which nothing is known
        for name, (values, style) in columns.items():
            if name != "tolerance":
                points = {"drawPoints": True, "strokeWidth": 0, "pointSize": 3}
                columns[name] = (values, style | points)
    rows: list[tuple[float, list[Any]]] = [
        (float(w), [float(max(x, 1e-17)) if np.isfinite(x) else None for x in of])
        for w, *of in zip(
            claim.omega * HZ, *(values for values, _ in columns.values()), strict=True
        )
    ]
    for last, following in zip(claim.bands[:-1, 1], claim.bands[1:, 0], strict=True):
        rows.append((float(0.5 * (last + following) * HZ), len(columns) * ["gap"]))
    rows.sort(key=lambda row: row[0])
    return {
        "labels": ["frequency", *columns],
        "rows": [[hz, *of] for hz, of in rows] if columns else [],
        "series": {name: style for name, (_, style) in columns.items()},
    }
