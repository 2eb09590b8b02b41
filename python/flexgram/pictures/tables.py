"""Tables of a page about a reduced body: its numbers, modes, interfaces, plan."""

from __future__ import annotations

import html
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from flexgram.basics import BodyError, Floats
from flexgram.body.whole import mass_facts, words_of_inertia, words_of_materials
from flexgram.measured import mode_shapes
from flexgram.model.damped_modes import NaturalModes, losses, sensitivities
from flexgram.model.geometry import body_of, interface_positions
from flexgram.model.reduced import ReducedBody


def sentence(model: ReducedBody) -> str:
    """What is claimed, and where nothing is."""
    claim = model.claim
    hz = " and ".join(
        f"from {a:g} to {b:g} Hz" if a < b else f"at {a:g} Hz" for a, b in claim.bands / (2 * np.pi)
    )
    if not np.isfinite(claim.supremum):
        return f"Nothing is claimed of the error {hz}."
    asked = ""
    if claim.tolerance is not None:
        asked = f" The tolerance of {claim.tolerance:g} is {'met' if claim.met else 'not met'}."
    size = "at most" if claim.kind.startswith("certified") else "about"
    label = claim.label
    if claim.kind == "certified outside":
        count = len(claim.excluded)
        several = "s" if count != 1 else ""
        label = f"certified but in {count} narrow interval{several} around undamped resonances"
    return (
        f"{hz[0].upper()}{hz[1:]} the responses of the reduced body differ from those of the full "
        f"model by {size} {claim.supremum:.1e} of {claim.plain_reference} ({label}).{asked} "
        "Outside of this nothing is claimed."
    )


def meaning(model: ReducedBody) -> str:
    """What a certified error is, of this body."""
    claim = model.claim
    kinds = ", and of each kind, such as displacements from forces" if len(claim.by_kind) else ""
    but = ", but in the intervals that are named" if len(claim.excluded) else ""
    values = ", with the values of the parameters that are named" if claim.parameters else ""
    return (
        "The responses are the matrix H of all outputs to unit loads at all inputs. The error is "
        f"that of its norm{kinds}: a single pair of ports that answers weakly may err by a larger "
        f"part of itself. The bound holds at every frequency of the band{but}{values}, not at "
        "samples alone. It follows from the residual of the equations of the full model, and is "
        "proved but for one constant: random vectors bound the smallest eigenvalue, and are wrong "
        "with a chance of one in six million. The error of the mesh and of the material's data "
        "against the real part is not included."
    )


def plan(facts: list[tuple[str, str]]) -> str:
    """What was done, and what was skipped."""
    rows = []
    for name, value in facts:
        kind = ' class="skipped"' if name == "skipped" else ""
        rows.append(f"<tr{kind}><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>")
    return f"<table>{''.join(rows)}</table>"


def modes(
    model: ReducedBody,
    drawn: int = 0,
    natural: NaturalModes | None = None,
    of_mesh: dict[int, float] | None = None,
    most: int = 200,
) -> str:
    """Frequencies, damping and effective masses; the first ``drawn`` elastic ones are buttons that
    show them. ``of_mesh``: by their numbers, how far the mesh makes frequencies too high."""
    by_parameter = sensitivities(model.system) if model.system.parameters else {}
    natural = natural or NaturalModes.of(model)
    model, shapes, rigid = natural.model, natural.shapes, natural.rigid
    poles = replace(model.system, terms=()).poles()
    poles = poles[poles.imag >= 0]
    lost = losses(model.system, natural.omega**2, shapes)
    frequencies = natural.omega if model.system.terms else model.modes
    masses = mode_shapes.effective_masses(model, shapes)
    rows = []
    for j, omega in enumerate(frequencies[:most]):
        if j < rigid:
            rows.append(f"<tr><td class=n>{j + 1}</td><td class=n>0</td><td>rigid</td></tr>")
            continue
        near = poles[np.argmin(np.abs(np.abs(poles) - model.modes[j]))]
        zeta = -near.real / max(omega, 1e-300) + 0.5 * (model.system.eta + lost[j])
        inside = "" if model.claim.band[0] <= omega <= model.claim.band[1] else "outside the band"
        number = f"{omega / (2 * np.pi):.6g}"
        if j - rigid < drawn:
            number = f"<button data-motion={j - rigid} aria-pressed=false>{number}</button>"
        rows.append(
            f"<tr><td class=n>{j + 1}</td><td class=n>{number}</td>"
            f"<td class=n>{100 * zeta:.3g} %</td>"
            + (f"<td class=n>{_per_cent(of_mesh.get(j))}</td>" if of_mesh else "")
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
    of_parameters = ("<th>mesh [%]</th>" if of_mesh else "") + of_parameters
    return (
        "<div class=tall><table><tr><th>no.</th><th>frequency [Hz]</th><th>damping ratio</th>"
        f"{of_parameters}{of_masses}<th></th></tr>{''.join(rows)}</table></div>{more}{said}"
    )


def _per_cent(error: float | None) -> str:
    return "" if error is None else f"{100 * error:.2g}"


def error_of_mesh(natural: NaturalModes, errors: dict[int, float]) -> str:
    """What the mesh itself makes of the natural frequencies, in words; empty if it is not known."""
    if not errors:
        return ""
    worst = max(errors, key=lambda j: errors[j])
    hz = natural.omega[worst] / (2 * np.pi)
    return (
        f"the mesh makes natural frequencies in the band too high. Mode {worst + 1} ({hz:.5g} Hz) "
        f"is worst, by about {_per_cent(errors[worst])} %. This is an estimate from jumps of "
        "stress between elements, often half of the true error. The claim does not include it"
    )


def _numbers(rows: Any, j: int) -> str:
    """Cells of a row of numbers, if there are some."""
    return "" if rows is None else "".join(f"<td class=n>{x:.4g}</td>" for x in rows[j])


def cards(model: ReducedBody) -> str:
    """The numbers that come first."""
    claim = model.claim
    # By the size of the error: a proof of 23 % is no good news. Beside the rigid motion of a free
    # body an error is small that is none beside its elastic motion.
    is_of_all = claim.bounds_elastic_part or not model.frame.rigid_modes
    colour = (
        "poor"
        if not claim.supremum <= 0.1 or not claim.met
        else "good"
        if claim.supremum <= 0.01 and claim.kind.startswith("certified") and is_of_all
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
            f"{claim.supremum:.1e}" if np.isfinite(claim.supremum) else "not known",
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
        count, ranks = int(log.get("factorisations", 0)), int(log.get("ranks", 1))
        cards.append(
            (
                f"{seconds:.2f} s",
                f"{count} factorisation{'s' * (count != 1)}, {ranks} rank{'s' * (ranks != 1)}",
                "",
            )
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


def held(model: ReducedBody) -> str:
    """Frequencies and static compliance with each interface held."""
    lines = "".join(f"<li>{html.escape(line)}</li>" for line in model.claim.words_of_held)
    return (
        f"<p>Without damping, against the model it was cut from:</p><ul>{lines}</ul>"
        if lines
        else ""
    )


def interfaces(model: ReducedBody, body: str | Path | None) -> str:
    """Where each interface is, and its ports; mass and inertia of the body."""
    of_ports: dict[str, list[str]] = {}
    for port in model.inputs:
        name, _, direction = port.rpartition(".")
        of_ports.setdefault(name or port, []).append(direction if name else "")
    try:
        positions = interface_positions(model, body)
    except BodyError:
        positions = {}
    rows = []
    for name, directions in of_ports.items():
        at = positions.get(name)
        place = "" if at is None else ", ".join(f"{x + 0.0:.5g}" for x in np.round(at, 9))
        rows.append(
            f"<tr><td>{html.escape(name)}</td><td>{html.escape(' '.join(directions))}</td>"
            f"<td>{place}</td></tr>"
        )
    others = [name for name in model.outputs if name not in model.inputs]
    more = f"<p class=lead>Outputs beside these: {html.escape(', '.join(others))}.</p>"
    return (
        "<div class=tall><table><tr><th>interface</th><th>ports</th><th>position [m]</th></tr>"
        f"{''.join(rows)}</table></div>{more if others else ''}{weight(model, body)}"
    )


def weight(model: ReducedBody, body: str | Path | None) -> str:
    """Mass, centre and inertia, in a sentence; empty if they are not known."""
    materials = _materials(model, body)
    integrals = model.frame.integrals
    if integrals is not None:
        mass, centre = integrals.mass, np.asarray(integrals.centre)
        about = integrals.M_r[3:, 3:] - mass * (
            centre @ centre * np.eye(3) - np.outer(centre, centre)
        )
        return of_mass(mass, centre, about) + materials
    try:
        with h5py.File(body_of(model, body)) as file:
            if "mesh/blocks" not in file:
                return ""
            facts = mass_facts(file)
    except (BodyError, OSError):
        return ""
    return of_mass(facts.mass, facts.centre, facts.inertia) + materials


def _materials(model: ReducedBody, body: str | Path | None) -> str:
    """Of a body that flexgram assembled, and its damping."""
    try:
        with h5py.File(body_of(model, body)) as file:
            lines = words_of_materials(file)
            given = [
                f"{name} = {float(file.attrs[name]):.4g}{unit}"
                for name, unit in (("alpha", " 1/s"), ("beta", " s"), ("eta", ""))
                if file.attrs.get(name)
            ]
    except (BodyError, OSError):
        return ""
    lines += [f"damping: {', '.join(given)}"] if given else []
    return "".join(
        f"<p class=lead>{html.escape(line[0].upper() + line[1:])}.</p>" for line in lines
    )


def of_mass(mass: float, centre: Floats, inertia: Floats) -> str:
    """In a sentence."""
    at = ", ".join(f"{x:.4g}" for x in centre)
    moments = words_of_inertia(inertia)
    return f"<p>Mass {mass:.6g} kg, centre at ({at}) m, moments of inertia about it {moments}.</p>"
