"""One self-contained HTML page about a reduced body."""

from __future__ import annotations

import base64
import html
import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from flexgram.basics import BodyError, written_aside
from flexgram.body.stress import von_mises
from flexgram.measured import mode_shapes
from flexgram.model.damped_modes import NaturalModes
from flexgram.model.mesh_error import mesh_errors, modes_to_judge
from flexgram.model.recovery import stress_at_nodes, words_of_stress
from flexgram.model.reduced import ReducedBody
from flexgram.pictures import figures, page, tables
from flexgram.pictures.charts import responses
from flexgram.pictures.scene import Scene, libraries
from flexgram.pictures.space import Space
from flexgram.simulation.histories import judge, read_history
from flexgram.simulation.motions import Motion

#: The page warns where the mesh makes natural frequencies this much too high.
COARSE = 0.05
#: Of the stress of a free body under a load history.
FREE = (
    " Only the loads of this history count. Forces of joints hold neither gravity nor the inertia "
    "of a large motion (a swing, a spin): the stress of such a motion is that of its coordinates "
    "in the multibody code (report --motion)."
)


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


def _when(log: dict[str, Any]) -> str:
    """When, where, and with which options the body was reduced."""
    told = ""
    if "date" in log:
        told = html.escape(f", {log['date']} on {log.get('host', '')}")
    if log.get("given"):
        told += f"; <code>{html.escape(str(log['given']))}</code>"
    return told


def _stress(motion: Motion, words: str, model: ReducedBody, body: str | Path | None) -> str:
    """The stress of a motion: its worst moment, in words, and over time."""
    assert motion.peaks is not None
    if motion.is_given:
        about = (
            " The moments are those of the file: the loads of the multibody code count, gravity and"
            " inertia too, as far as the coordinates hold them."
        )
    else:
        about = (
            " The body is at rest in the beginning: loads that start suddenly let it vibrate."
        ) + (FREE if model.frame.rigid_modes else "")
    claim = (
        ""
        if motion.stresses
        else " Nothing is claimed of it: make it an output of the body (type: stress)."
    )
    u = motion.u[motion.worst]
    picture = figures.stress(motion.part, motion.q[motion.worst], body, u=u)
    return (
        f"<p>{words[0].upper()}{words[1:]}.{about}{claim}</p>"
        + _image(
            figures.stress_over_time(motion.t, motion.peaks.over_time, motion.stresses),
            "Stress over time: the largest anywhere, and that of outputs.",
        )
        + _image(picture, "Von Mises stress at that moment, deformation enlarged.", raster=True)
    )


#: Figures that assemblies do not have.
OF_BODIES = ("gramian", "stages")


class Report:
    """The parts of the page of one body.

    Attributes
    ----------
    told : list of str
        What the page says of a load history and of a motion.
    left : list of str
        What could not be shown, and why.
    """

    def __init__(self, model: ReducedBody, body: str | Path | None) -> None:
        self.model, self.body = model, body
        self.made = model.provenance
        self.told: list[str] = []
        self.left: list[str] = []
        self.data: dict[str, Any] = {}
        self.scene: Scene | None = None
        self.natural: NaturalModes | None = None
        self.motion: Motion | None = None
        self.is_live = bool(libraries())
        if not self.is_live:
            self.left.append(page.WITHOUT)

    def draw(self, name: str, caption: str, raster: bool = False, **arguments: Any) -> str:
        """A figure of ``pictures.figures``; empty if it cannot be drawn."""
        try:
            return _image(figures.FIGURES[name](self.model, **arguments), caption, raster)
        except BodyError as reason:
            if name not in OF_BODIES or not self.model.basis.parts:
                self.left.append(f"{name}: {reason}")
            return ""

    def _name(self, rom: Path) -> str:
        names = (self.made.body or str(rom)).split(" with ")
        return " with ".join(Path(name).stem for name in names)

    def head(self, rom: Path) -> list[str]:
        """Name, numbers, warnings."""
        made = self.made
        return [
            f"<h1>{html.escape(self._name(rom))}, reduced</h1>",
            f"<p class=lead>{html.escape(made.body)} by flexgram ({html.escape(made.stages)}), "
            f"in {html.escape(rom.name)}{_when(made.log)}</p>",
            f'<p class="claim">{html.escape(tables.sentence(self.model))}</p>',
            "<details><summary>What this means</summary>"
            f"<p>{html.escape(tables.meaning(self.model))}</p></details>"
            if self.model.claim.kind.startswith("certified")
            else "",
            tables.cards(self.model),
            *(f'<p class="warning">{html.escape(w)}</p>' for w in made.warnings),
        ]

    def response(self, sweep: Path | None, ports: list[tuple[str, str]] | None) -> list[str]:
        """H and the error, and the order."""
        gramian = "Eigenvalues of the position Gramian over the band, and the order taken."
        error = (
            "Error of the transfer matrix in the Frobenius norm, "
            f"{self.model.claim.words_of_reference}.{_of_which(self.model)}"
        )
        if self.is_live:
            data = self.data["chart-data"] = responses(self.model, sweep, ports)
            return [
                "<h2>Responses and error</h2>",
                page.charts(data, sweep is not None),
                f"<p class=lead>{html.escape(error)} Grey: where nothing is claimed.</p>",
                "<details><summary>Why this order</summary>",
                self.draw("gramian", gramian),
                "</details>",
            ]
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

    def move(self, loads: str | Path | None, coordinates: str | Path | None) -> None:
        """What the body does over time, if something is known of it."""
        try:
            if coordinates is not None:
                self.motion = Motion.given(self.model, coordinates, self.body, loads)
            elif loads is not None:
                self.motion = Motion.answer(self.model, loads, self.body)
        except BodyError as reason:
            if coordinates is not None:
                raise
            self.left.append(f"the answer to the load history: {reason}")

    def history(self, loads: str | Path) -> list[str]:
        """A load history: its spectrum, what the claim says of the answer, the largest stress."""
        history = read_history(loads, self.model.inputs)
        verdict = judge(self.model, *history)
        self.told += verdict.words
        return [
            f"<h2>The load history {html.escape(Path(loads).name)}</h2>",
            "".join(
                f"<p>{html.escape(words[0].upper() + words[1:])}.</p>" for words in verdict.words
            ),
            _image(figures.loads(self.model, verdict), "Amplitudes, and the band."),
        ]

    def stress(self, coordinates: str | Path | None) -> list[str]:
        """The stress of a motion."""
        parts = []
        if self.motion is not None and self.motion.peaks is None and coordinates is not None:
            self.left.append("stress: the body has none, or its body file is missing")
        if self.motion is not None and self.motion.peaks is not None:
            if coordinates is not None:
                parts.append(f"<h2>The motion {html.escape(Path(coordinates).name)}</h2>")
            parts += (f'<p class="warning">{html.escape(d)}.</p>' for d in self.motion.doubts)
            self.told += self.motion.doubts
            words = words_of_stress(self.motion.part, self.motion.t, self.motion.peaks, self.body)
            parts.append(_stress(self.motion, words, self.model, self.body))
            parts.append(
                "<p class=lead>The error of this stress has no bound: only outputs that are stress "
                "have one (--measure NAME=stress:WHERE). At sharp inner corners stress depends on "
                "the mesh.</p>"
            )
            self.told.append(words)
        return parts

    def shapes(self) -> list[str]:
        """The body in space: its lowest modes, its motion."""
        if not self.is_live:
            caption = "Surface with the interfaces; lowest elastic modes of the body, enlarged."
            picture = self.draw("shapes", caption, raster=True, body=self.body)
            return ["<h2>Shapes</h2>", picture] if picture else []
        try:
            space = Space.of(self.model, self.body)
            scene = Scene.of(space.geometry)
            natural = self.natural = NaturalModes.of(self.model)
            hz, modes = natural.elastic(min(scene.room, 24))
            motion = space.motion(self.model, modes) if len(modes) else np.empty((0, 0, 3))
        except BodyError as reason:
            self.left.append(f"shapes: {reason}")
            return []
        for k, field in enumerate(motion):
            scene.add_motion(f"mode {natural.rigid + k + 1}, {hz[k]:.5g} Hz", field)
        if self.motion is not None:
            self._add_motion(scene, space, self.motion)
        self.scene = scene
        self.data["scene-data"] = scene.data()
        what = "assembly" if self.model.basis.parts else "body"
        return [f"<h2>The {what}</h2>", page.viewer(scene)]

    def _add_motion(self, scene: Scene, space: Space, motion: Motion) -> None:
        """Some moments and the worst one, with their stress if known."""
        few = motion.moments
        q, stress, most = motion.q[few], None, None
        if motion.peaks is not None:
            at_nodes = stress_at_nodes(motion.part, q, self.body, motion.u[few], "larger")
            stress, most = von_mises(at_nodes), motion.peaks.von_mises.value
        name = "motion of the multibody code" if motion.is_given else "load history"
        moved = space.motion(motion.part, q)
        scene.set_history(motion.t[few], moved, stress, len(motion.t), most, name)

    def _errors_of_mesh(self, natural: NaturalModes) -> dict[int, float]:
        """By numbers of modes in the band, how far the mesh makes frequencies too high."""
        numbers = modes_to_judge(natural)
        try:
            errors = mesh_errors(self.model, numbers, self.body, natural)
        except BodyError:
            return {}
        return dict(zip(numbers.tolist(), errors.tolist(), strict=True))

    def plan_and_modes(self) -> list[str]:
        """The modes, free and held; interfaces and mass; what was done."""
        natural = self.natural or NaturalModes.of(self.model)
        of_mesh = self._errors_of_mesh(natural)
        coarse = max(of_mesh.values(), default=0) > COARSE
        words = tables.error_of_mesh(natural, of_mesh)
        if coarse:
            self.told.append(f"{words}. Smaller elements, or those of second order, make it less")
        plan = tables.plan(self.made.plan) if self.made.plan else "<p>not stored</p>"
        drawn = len(self.scene.motions) if self.scene else 0
        return [
            "<h2>Modes of the reduced body</h2>",
            f"<p class={'warning' if coarse else 'lead'}>{words[0].upper()}{words[1:]}.</p>"
            if words
            else "",
            tables.modes(self.model, drawn, natural, of_mesh),
            tables.held(self.model),
            "<h2>Interfaces and mass</h2>",
            tables.interfaces(self.model, self.body),
            "<h2>How it was made</h2><details><summary>Plan: what was done, what was skipped and "
            "why</summary>",
            plan,
            "</details>",
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
            "<details><summary>Time by stage</summary>",
            self.draw("stages", "Wall clock."),
            f"</details><details><summary>All options</summary><table>{''.join(rows)}",
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
    motion: str | Path | None = None,
    measured: str | Path | None = None,
) -> Report:
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
        Transfer functions that come first; default: the strongest force and moment. The page has
        as many others as it has room for.
    loads : str or Path, optional
        Load history (``flexgram.simulation.histories.read_history``): its spectrum, and what the
        claim says of the response to it, and the stress of that from rest.
    motion : str or Path, optional
        Elastic coordinates over time that a multibody code wrote
        (``flexgram.simulation.motions.read_coordinates``): their stress, instead of that of the
        answer to ``loads``.
    measured : str or Path, optional
        Universal file of a test: how its modes compare (``flexgram.measured.mode_shapes``).

    Returns
    -------
    Report
        ``told``, and ``left``, what could not be shown.

    Examples
    --------
    >>> write_report("rack.rom.h5", "rack.html").left
    []
    """
    page.expect_name(output)
    if sweep is not None and not Path(sweep).exists():
        raise BodyError(f"{sweep}: no such file")
    made = Report(ReducedBody.load(rom), body)
    made.move(loads, motion)
    parts = [
        *made.head(Path(rom)),
        *made.shapes(),
        *made.response(None if sweep is None else Path(sweep), ports),
        *(made.history(loads) if loads is not None else ()),
        *made.stress(motion),
        *made.plan_and_modes(),
        *(made.measured(measured) if measured is not None else ()),
        *made.times(),
    ]
    text = page.document(Path(rom).name, parts, made.data)
    with written_aside(output, rom, body, sweep, loads, motion, measured) as place:
        place.write_text(text)
    return made


def _of_which(model: ReducedBody) -> str:
    """That curves of all of H are not the claim, where a kind of responses errs more."""
    claim = model.claim
    if not len(claim.by_kind) or not claim.by_kind.max() > 1.2 * claim.whole:
        return ""
    worst = claim.kinds[int(np.argmax(claim.by_kind))]
    return (
        f" The curves are of all of H, whose error is at most {claim.whole:.1e}. The claim is the "
        f"largest of the kinds of responses, {claim.by_kind.max():.1e} of {worst}."
    )
