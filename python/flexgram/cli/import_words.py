"""What an import prints of the body that it wrote."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexgram.basics import counted, say
from flexgram.body.whole import damping_lines, words_of_inertia


def _lengths(numbers: Any) -> str:
    return " × ".join(f"{x:.4g}" for x in numbers)


def _interface(facts: dict[str, Any]) -> str:
    """An interface in a line: coupling, nodes, and where its reference is and why there."""
    at = ", ".join(f"{x:.6g}" for x in facts["position"])
    why = f": {facts['middle']}" if facts["middle"] else ""
    return f"{facts['coupling']}, {counted(facts['nodes'], 'node')}, reference at ({at}) m{why}"


def say_mesh(output: Path, counts: dict[str, Any]) -> None:
    """Of a body that flexgram assembles."""
    say(
        f"  {output}: {counted(counts['points'], 'node')}, {counted(counts['elements'], 'element')}"
    )
    say(f"  it measures {_lengths(counts['extent'])} m")
    for name, facts in counts["interfaces"].items():
        say(f"  interface {name}: {_interface(facts)}")
        if facts["distance"] > 3 and facts["nodes"] > 1:
            say(
                f"  warning: the reference of {name} is {facts['distance']:.0f} sizes of "
                "its node set away from its middle: right units?"
            )
    for line in counts["summary"]:
        say(f"  {line}")
    for kind in ("loads", "outputs"):
        for name, what in counts[kind].items():
            say(f"  {kind[:-1]} {name}: {what}")
    if {"tetra"} & set(counts["kinds"]):
        say("  note: linear tetrahedra are too stiff; second-order ones (tetra10) converge faster")
    if {"triangle"} & set(counts["kinds"]):
        say(
            "  note: triangles of shells are too stiff in their plane, where webs and stiffeners "
            "bend; quadrilaterals converge faster (gmsh: Mesh.RecombineAll)"
        )
    if max(counts["extent"]) > 15 and counts["units"] == "SI":
        say(
            f"  note: the part measures {max(counts['extent']):.4g} m: is the mesh in "
            "millimetres (--units mm-t-s)?"
        )


def say_damping(facts: dict[str, Any]) -> None:
    """Of a body of matrices."""
    is_free = facts.get("free", 0) > 0
    for line in damping_lines(facts["damping"], further=facts["losses"], is_free=is_free):
        say(f"  {line}")


def say_matrices(output: Path, facts: dict[str, Any]) -> None:
    """Of a body of matrices."""
    say(f"  {output}: n = {facts['rows']}, {facts['nonzeros']:.3g} nonzeros in K as read")
    if "extent" in facts:
        say(f"  it measures {_lengths(facts['extent'])} m")
    if "mass" in facts:
        at = ", ".join(f"{x:.6g}" for x in facts["centre"])
        inertia = words_of_inertia(facts["inertia"])
        say(
            f"  mass {facts['mass']:.6g} kg of the free rows, centre ({at}) m, inertia about it "
            f"{inertia}"
        )
        left = f"{facts['free']} of 6 rigid motions are free"
        say(f"  {left} (relative energy at most {facts['rigid_energy'].max():.0e})")
    for name, interface in facts["interfaces"].items():
        say(f"  interface {name}: {_interface(interface)}")
    say(
        f"  {len(facts['ports'])} ports: {', '.join(facts['ports'][:12])}"
        f"{' …' if len(facts['ports']) > 12 else ''}"
    )
    for remark in facts["remarks"]:
        say(f"  note: {remark}")
