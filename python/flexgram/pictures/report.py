"""One self-contained HTML page about a reduced body."""

from __future__ import annotations

import base64
import html
import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from flexgram.basics import BodyError, written_aside
from flexgram.body.stress import Stresses
from flexgram.measured import mode_shapes
from flexgram.model.damped_modes import losses, modes_of, sensitivities
from flexgram.model.elastic_part import without_rigid_modes
from flexgram.model.geometry import body_of
from flexgram.model.recovery import stress_peaks, words_of_stress
from flexgram.model.reduced import ReducedBody
from flexgram.pictures import figures
from flexgram.simulation.histories import evenly, judge, read_history

STYLE = """
:root { color-scheme: light; --ink: #1c2733; --soft: #5b6b7a; --line: #d8dee4; --accent: #0868ac; }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); margin: 0 auto; max-width: 62rem;
       padding: 1.5rem; }
h1 { font-size: 1.7rem; margin: 0 0 .2rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .6rem;
       border-bottom: 1px solid var(--line); padding-bottom: .2rem; }
.lead { color: var(--soft); margin: 0 0 1rem; }
.cards { display: grid; gap: .8rem; }
.card:first-child { grid-column: span var(--first, 1); }
@media (min-width: 40rem) { .columns-3 { grid-template-columns: repeat(3, 1fr); }
       .columns-2 { grid-template-columns: repeat(2, 1fr); } }
.card { border: 1px solid var(--line); border-radius: .5rem; padding: .7rem; }
.card b { display: block; font-size: 1.35rem; }
.card span { color: var(--soft); font-size: .85rem; }
.good b { color: #1a7f37; } .fair b { color: #b35900; } .poor b { color: #c0392b; }
table { border-collapse: collapse; } td, th { padding: .15rem .9rem .15rem 0; text-align: left;
       vertical-align: top; border-bottom: 1px solid #eef1f4; } th { color: var(--soft);
       font-weight: 500; } td.n { text-align: right; font-variant-numeric: tabular-nums; }
.skipped td { color: var(--soft); } figure { margin: 0; } img { max-width: 100%; height: auto; }
.pair { display: grid; gap: 1rem;
       grid-template-columns: repeat(auto-fit, minmax(24rem, 1fr)); }
.warning { border-left: 4px solid #d4a72c; background: #fff8e1; padding: .5rem .8rem;
       margin: .5rem 0; }
details { margin-top: .6rem; } code { font-size: .85em; }
"""


def _image(figure: Figure, caption: str, raster: bool = False) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png" if raster else "svg", dpi=110)
    kind = "png" if raster else "svg+xml"
    data = base64.b64encode(buffer.getvalue()).decode()
    text = html.escape(caption)
    return (
        f'<figure><img alt="{text}" src="data:image/{kind};base64,{data}">'
        f"<figcaption class='lead'>{text}</figcaption></figure>"
    )


def _plan(facts: list[tuple[str, str]]) -> str:
    rows = []
    for name, value in facts:
        kind = ' class="skipped"' if name == "skipped" else ""
        rows.append(f"<tr{kind}><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>")
    return f"<table>{''.join(rows)}</table>"


def _modes(model: ReducedBody, most: int = 40) -> str:
    by_parameter = sensitivities(model.system) if model.system.parameters else {}
    model = model.at() if model.system.parameters else model
    poles = replace(model.system, terms=()).poles()
    poles = poles[poles.imag >= 0]
    squares, shapes = modes_of(model.system)
    lost = losses(model.system, squares, shapes)
    frequencies = np.sqrt(np.maximum(squares, 0)) if model.system.terms else model.modes
    masses = mode_shapes.effective_masses(model, shapes)
    rows = []
    rigid = int(np.sum(frequencies < 1e-6 * max(frequencies.max(initial=0), 1e-300)))
    for j, omega in enumerate(frequencies[:most]):
        if j < rigid:
            rows.append(f"<tr><td class=n>{j + 1}</td><td class=n>0</td><td>rigid</td></tr>")
            continue
        near = poles[np.argmin(np.abs(np.abs(poles) - model.modes[j]))]
        zeta = -near.real / max(omega, 1e-300) + 0.5 * (model.system.eta + lost[j])
        inside = "" if model.claim.band[0] <= omega <= model.claim.band[1] else "outside the band"
        rows.append(
            f"<tr><td class=n>{j + 1}</td><td class=n>{omega / (2 * np.pi):.6g}</td>"
            f"<td class=n>{100 * zeta:.3g} %</td>"
            + "".join(f"<td class=n>{of[j]:.3f}</td>" for of in by_parameter.values())
            + f"{_numbers(masses, j)}<td>{inside}</td></tr>"
        )
    more = (
        f"<p class=lead>and {len(model.modes) - most} higher</p>" if len(model.modes) > most else ""
    )
    of_masses = "" if masses is None else "".join(f"<th>m<sub>{a}</sub> [kg]</th>" for a in "xyz")
    said = (
        "<p class=lead>m: effective masses, the squares of the participation factors of modes of "
        "unit mass.</p>"
        if of_masses
        else ""
    )
    of_parameters = "".join(f"<th>{html.escape(name)}</th>" for name in by_parameter)
    if by_parameter:
        said += (
            "<p class=lead>Of a parameter: the relative change of the frequency by that of the "
            "parameter, at its present value.</p>"
        )
    return (
        f"<table><tr><th>no.</th><th>frequency [Hz]</th><th>damping ratio</th>"
        f"{of_parameters}{of_masses}<th></th></tr>{''.join(rows)}</table>{more}{said}"
    )


def _numbers(rows: Any, j: int) -> str:
    """Cells of a row of numbers, if there are some."""
    return "" if rows is None else "".join(f"<td class=n>{x:.4g}</td>" for x in rows[j])


def _cards(model: ReducedBody) -> str:
    claim = model.claim
    # By the size of the error: a proof of 23 % is no good news.
    colour = (
        "poor"
        if not claim.supremum <= 0.1 or not claim.met
        else "good"
        if claim.supremum <= 0.01 and claim.kind.startswith("certified")
        else "fair"
    )
    hz = claim.bands / (2 * np.pi)
    kinds = ""
    if len(claim.by_kind):
        of = [f"{kind} {value:.1e}" for kind, value in zip(claim.kinds, claim.by_kind, strict=True)]
        if len(claim.kind_tolerances):
            of = [f"{said} of {t:g}" for said, t in zip(of, claim.kind_tolerances, strict=True)]
        kinds = f": the largest of all of H {claim.whole:.1e}, {', '.join(of)}"
    notes = claim.shortfall, claim.words_of_data
    cards = [
        (
            f"{claim.supremum:.1e}",
            f"largest relative error over the band, {claim.label}"
            + kinds
            + "".join(f"; {said}" for said in notes if said),
            colour,
        ),
        (
            f"{len(model.basis.V):,} → {model.order}" if len(model.basis.V) else str(model.order),
            "degrees of freedom",
            "",
        ),
        (", ".join(f"{first:g} – {last:g}" for first, last in hz) + " Hz", "band", ""),
        (f"{len(model.inputs)} / {len(model.outputs)}", "inputs / outputs", ""),
    ]
    log, seconds = model.provenance.log, sum(model.provenance.seconds.values())
    if seconds:
        count = int(log.get("factorisations", 0))
        cards.append(
            (f"{seconds:.2f} s", f"{count} factorisations, {int(log.get('ranks', 1))} rank(s)", "")
        )
    peak = log.get("peak_memory_mb_per_rank")
    if peak:
        cards.append((f"{float(peak):.0f} MB", "peak memory on a rank", ""))
    tiles = "".join(
        f'<div class="card {kind}"><b>{value}</b><span>{html.escape(what)}</span></div>'
        for value, what, kind in cards
    )
    columns = 3 if len(cards) in (3, 5, 6) else 2  # full rows, the first tile makes up for one
    first = ' style="--first: 2"' if len(cards) == 5 else ""
    return f'<div class="cards columns-{columns}"{first}>{tiles}</div>'


def _held(model: ReducedBody) -> str:
    """Frequencies and static compliance with each interface held."""
    lines = "".join(f"<li>{html.escape(line)}</li>" for line in model.claim.words_of_held)
    return (
        f"<p>Without damping, against the model it was cut from:</p><ul>{lines}</ul>"
        if lines
        else ""
    )


def _when(log: dict[str, Any]) -> str:
    """When, where, and with which options the body was reduced."""
    told = ""
    if "date" in log:
        told = html.escape(f", {log['date']} on {log.get('host', '')}")
    if log.get("given"):
        told += f"; <code>{html.escape(str(log['given']))}</code>"
    return told


def _has_stress(model: ReducedBody, body: str | Path | None) -> bool:
    try:
        Stresses.load(body_of(model, body))
    except BodyError:
        return False
    return True


def _stress(model: ReducedBody, t: Any, u: Any, body: str | Path | None) -> str:
    """The worst moment of a load history, from rest."""
    part = without_rigid_modes(model)  # rigid motion strains nothing
    t, u = evenly(t, u)
    _, q = part.system.simulate(u, t)
    peaks = stress_peaks(part, q, u, body)
    words = words_of_stress(part, t, peaks, body)
    worst = peaks.von_mises.when
    claim = (
        ""
        if any(re.search(r"\.s[xyz]{2}$", name) for name in model.outputs)
        else (" Nothing is claimed of it: make it an output of the body (type: stress).")
    )
    picture = figures.stress(part, q[worst], body, u=u[worst])
    return (
        f"<p>{words[0].upper()}{words[1:]}, of a body at rest in the beginning.{claim}</p>"
        + _image(picture, "Von Mises stress at that moment, deformation enlarged.", raster=True)
    )


class _Page:
    """The parts of the page of one body; ``left``: what could not be shown, and why."""

    def __init__(self, model: ReducedBody, body: str | Path | None) -> None:
        self.model, self.body = model, body
        self.made = model.provenance
        self.left: list[str] = []

    def draw(self, name: str, caption: str, raster: bool = False, **arguments: Any) -> str:
        """A figure of ``pictures.figures``; empty if it cannot be drawn."""
        try:
            return _image(figures.FIGURES[name](self.model, **arguments), caption, raster)
        except BodyError as reason:
            self.left.append(f"{name}: {reason}")
            return ""

    def head(self, rom: Path) -> list[str]:
        """Name, numbers, warnings."""
        made = self.made
        return [
            f"<h1>{html.escape(Path(made.body or rom).stem)}, reduced</h1>",
            f"<p class=lead>{html.escape(made.body)} by flexgram ({html.escape(made.stages)}), "
            f"in {html.escape(rom.name)}{_when(made.log)}</p>",
            _cards(self.model),
            *(f'<p class="warning">{html.escape(w)}</p>' for w in made.warnings),
        ]

    def response(self, sweep: Path | None, ports: list[tuple[str, str]] | None) -> list[str]:
        """The error, the order, and H."""
        error = (
            "Error of the transfer matrix in the Frobenius norm, "
            f"{self.model.claim.words_of_reference}."
        )
        gramian = "Eigenvalues of the position Gramian over the band, and the order taken."
        whose = (
            " of the full and the reduced body."
            if sweep
            else " of the reduced body (name a sweep file to compare with the full one)."
        )
        return [
            "<h2>Error over the band</h2>",
            self.draw("error", error),
            '<h2>Order and response</h2><div class="pair">',
            self.draw("gramian", gramian),
            self.draw("transfer", "Transfer functions" + whose, sweep=sweep, ports=ports),
            "</div>",
        ]

    def history(self, loads: str | Path) -> list[str]:
        """A load history: its spectrum, what the claim says of the answer, the largest stress."""
        history = read_history(loads, self.model.inputs)
        verdict = judge(self.model, *history)
        parts = [
            f"<h2>The load history {html.escape(Path(loads).name)}</h2>",
            "".join(
                f"<p>{html.escape(words[0].upper() + words[1:])}.</p>" for words in verdict.words
            ),
            _image(figures.loads(self.model, verdict), "Amplitudes, and the band."),
        ]
        if _has_stress(self.model, self.body):
            try:
                parts.append(_stress(self.model, *history, self.body))
            except BodyError as error:
                self.left.append(f"stress: {error}")
        return parts

    def shapes(self) -> list[str]:
        """The mesh and the lowest modes."""
        caption = "Surface with the interfaces; lowest elastic modes of the reduced body, enlarged."
        picture = self.draw("shapes", caption, raster=True, body=self.body)
        return ["<h2>Shapes</h2>", picture] if picture else []

    def plan_and_modes(self) -> list[str]:
        """What was done; the modes, free and held."""
        plan = _plan(self.made.plan) if self.made.plan else "<p>not stored</p>"
        return [
            "<h2>Plan: what was done, what was skipped and why</h2>",
            plan,
            "<h2>Modes of the reduced body</h2>",
            _modes(self.model),
            _held(self.model),
        ]

    def measured(self, file: str | Path) -> list[str]:
        """Modes of a test beside those of the body."""
        try:
            modes = mode_shapes.mode_shapes(self.model, self.body)
            found = mode_shapes.compare(mode_shapes.read_universal(file), modes)
        except BodyError as error:
            self.left.append(f"measured modes: {error}")
            return []
        rows = (f"<p>{html.escape(line[0].upper() + line[1:])}.</p>" for line in found.words())
        return [
            f"<h2>Measured modes of {html.escape(Path(file).name)}</h2>",
            *rows,
            _image(mode_shapes.picture(found), "Modal assurance criterion."),
        ]

    def times(self) -> list[str]:
        """Time by stage, options, versions."""
        options = dict(self.made.log.get("options", {}))
        versions = dict(self.made.log.get("versions", {}))
        rows = (
            f"<tr><th><code>{html.escape(k)}</code></th><td>{html.escape(str(v))}</td></tr>"
            for k, v in options.items()
        )
        told = html.escape(", ".join(f"{k} {v}" for k, v in versions.items()))
        return [
            "<h2>Time by stage</h2>",
            self.draw("stages", "Wall clock."),
            f"<details><summary>All options</summary><table>{''.join(rows)}",
            f"</table></details><p class=lead>{told}</p>",
        ]


def write_report(
    rom: str | Path,
    output: str | Path,
    *,
    body: str | Path | None = None,
    sweep: str | Path | None = None,
    ports: list[tuple[str, str]] | None = None,
    loads: str | Path | None = None,
    measured: str | Path | None = None,
) -> list[str]:
    """Write the page.

    Parameters
    ----------
    rom : str or Path
        Reduced file.
    output : str or Path
        ``.html`` file to write; nothing else is needed to show it.
    body : str or Path, optional
        Body file, for the picture of the mesh; default: the one that was reduced, if it is there.
    sweep : str or Path, optional
        Sweep file of the full body with the same ports, to compare H with.
    ports : list of (output, input), optional
        Transfer functions to draw; default: the strongest force and moment.
    loads : str or Path, optional
        Load history (``flexgram.simulation.histories.read_history``): its spectrum, and what the
        claim says of the response to it.
    measured : str or Path, optional
        Universal file of a test: how its modes compare (``flexgram.measured.mode_shapes``).

    Returns
    -------
    list of str
        What could not be shown, and why.

    Examples
    --------
    >>> write_report("rack.rom.h5", "rack.html")  # what could not be shown
    []
    """
    page = _Page(ReducedBody.load(rom), body)
    parts = [
        *page.head(Path(rom)),
        *page.response(None if sweep is None else Path(sweep), ports),
        *(page.history(loads) if loads is not None else ()),
        *page.shapes(),
        *page.plan_and_modes(),
        *(page.measured(measured) if measured is not None else ()),
        *page.times(),
    ]
    title = html.escape(Path(rom).name)
    text = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head>'
        f"<body>{''.join(parts)}</body></html>\n"
    )
    if Path(output).suffix.lower() not in (".html", ".htm"):
        raise BodyError(f"{output}: a report is a page: name it {Path(output).stem}.html")
    with written_aside(output, rom, body, sweep, loads, measured) as place:
        place.write_text(text)
    return page.left
