"""The frame of a page: its style, its scripts, the body to turn, responses to zoom into."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flexgram.basics import BodyError
from flexgram.pictures.drawings import still
from flexgram.pictures.scene import DIRECTION, Scene, libraries

#: Styles and scripts of our own.
OWN = Path(__file__).parent / "page"
WITHOUT = (
    "the body to turn and the responses to zoom into: their libraries are not installed (Debian: "
    "apt install libjs-three libjs-dygraphs)"
)
SIDES = {"a corner": ",".join(map(str, DIRECTION)), "x": "1,0,0", "y": "0,-1,0", "z": "0,-0.001,1"}


def expect_name(output: str | Path) -> None:
    """Raise BodyError for a page that is not named as one: it might be a file of another kind."""
    if Path(output).suffix.lower() not in (".html", ".htm"):
        raise BodyError(f"{output}: this is a page: name it {Path(output).stem}.html")


def document(title: str, parts: Sequence[str], data: dict[str, Any] | None = None) -> str:
    """One page that needs nothing else.

    Parameters
    ----------
    title : str
    parts : sequence of str
        HTML.
    data : dict, optional
        What scripts read, by the id of its element: ``scene-data``, ``chart-data``.
    """
    scripts, styles = [], [(OWN / "page.css").read_text()]
    if data:
        known = libraries()
        styles.append(known["dygraph_style"])
        for name, of in data.items():
            text = _inside(json.dumps(of, allow_nan=False))
            scripts.append(f'<script type="application/json" id="{name}">{text}</script>')
        code = []
        if "scene-data" in data:
            code += [known["three"], known["controls"]]
        if "chart-data" in data:
            code += [known["dygraph"], known["synchronizer"]]
        own = {"scene-data": "scene.js", "chart-data": "charts.js"}
        code += [_after_the_first_picture((OWN / own[name]).read_text()) for name in data]
        scripts += [f"<script>{_inside(text)}</script>" for text in code]
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f"<title>{html.escape(title)}</title>"
        f'<meta name="viewport" content="width=device-width"><style>{"".join(styles)}</style>'
        "</head>"
        f"<body>{''.join(parts)}{''.join(scripts)}</body></html>\n"
    )


def _after_the_first_picture(script: str) -> str:
    """A script that runs when the browser has drawn what needs none."""
    return f"requestAnimationFrame(function () {{ setTimeout(function () {{\n{script}}}); }});"


def _inside(text: str) -> str:
    """Text that does not end the element it is in."""
    return text.replace("</script", "<\\/script")


def viewer(scene: Scene, marked: str = "interfaces") -> str:
    """The body in space; ``scene.data()`` is what its script reads."""
    options = ['<option value="rest">at rest</option>']
    if scene.history is not None:
        options.append(f'<option value="history">{scene.history["name"]}</option>')
    options += [
        f'<option value="{k}">{html.escape(motion["name"])}</option>'
        for k, motion in enumerate(scene.motions)
    ]
    moves = bool(scene.motions or scene.history)
    hidden = "" if moves else " hidden"
    looks = "".join(
        f'<button data-look="{direction}">{name}</button>' for name, direction in SIDES.items()
    )
    few = ""
    if scene.whole > len(scene.triangles):
        few = (
            f" Drawn with {len(scene.triangles):,} triangles of {scene.whole:,}: nodes that lie "
            "close together are one."
        )
    drawn = ""
    if scene.history is not None:
        drawn = (
            f" Of the {scene.history['name']} {len(scene.history['times'])} of "
            f"{scene.history['count']:,} moments are drawn, the worst among them."
        )
    return (
        '<section id="scene"><div class="tools">'
        f"<label{hidden}>motion <select>{''.join(options)}</select></label>"
        f'<button class="play"{hidden}>play</button>'
        f'<label{hidden}>size <input class="size" type="range" min="0" max="3" step="0.05" '
        'value="1"></label>'
        f'<label><input class="names" type="checkbox" checked> {marked}</label>'
        f"<span>seen from {looks}</span></div>"
        f'<div class="view"><img class="still" alt="The body at rest." src="{still(scene)}"></div>'
        '<div class="tools"><label hidden>moment <input class="moment" type="range" min="0" '
        'value="0"></label></div><p class="told" aria-live="polite"></p>'
        '<div class="bar" hidden><span class="from"></span><i></i><span class="to"></span>'
        '<span class="words"></span></div><noscript>Scripts are off: the picture does not '
        "move.</noscript>"
        '<p class="lead">Drag or use the arrow keys to turn, the wheel or + and - to zoom'
        f"{', the space bar to play. Motions are enlarged' if moves else ''}.{few}{drawn}</p>"
        "</section>"
    )


def charts(data: dict[str, Any], has_sweep: bool) -> str:
    """Responses with a choice of ports, and the error below; ``data`` as of ``responses``."""
    outputs = dict.fromkeys(pair["output"] for pair in data["pairs"])
    inputs = dict.fromkeys(pair["input"] for pair in data["pairs"])
    first = data["pairs"][0]

    def choice(names: Any, chosen: str) -> str:
        return "".join(
            f"<option{' selected' if name == chosen else ''}>{html.escape(name)}</option>"
            for name in names
        )

    left = ""
    if data["left_out"]:
        count = len(data["pairs"])
        left = (
            f" {count} of {count + data['left_out']} pairs of ports are in this page; --port "
            "OUTPUT,INPUT adds one."
        )
    whose = "" if has_sweep else " --sweep FILE compares with the full body."
    if data["excluded"]:
        left += " Red: left out around undamped resonances."
    return (
        '<section id="charts"><div class="tools">'
        f'<label>output <select class="output">{choice(outputs, first["output"])}</select></label>'
        f'<label>from <select class="input">{choice(inputs, first["input"])}</select></label>'
        '<label><input class="logarithmic" type="checkbox"> logarithmic frequency</label>'
        '<button class="whole">whole band</button></div>'
        '<p class="unshown warning" hidden>This pair is not in the page: flexgram report --port '
        "OUTPUT,INPUT.</p>"
        '<div class="legend of-response"></div><div class="response"></div>'
        '<div class="legend of-error"></div><div class="error"></div>'
        f'<p class="lead">Drag to zoom, double click to zoom out.{left}{whose}</p></section>'
    )
