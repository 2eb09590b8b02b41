"""The verb campbell."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from flexgram.basics import BodyError, expect_kept, say, written_aside

if TYPE_CHECKING:
    from flexgram.model.campbell import Campbell, CriticalSpeed

PICTURES = (".png", ".svg", ".pdf")


def campbell_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rom", type=Path, help="reduced file of a body with a range of speeds")
    parser.add_argument(
        "--speeds",
        metavar="FROM,TO[,COUNT]",
        help="[rad/s] default: all that the body knows, 61 of them",
    )
    parser.add_argument("--modes", type=int, help="how many of the lowest; default: those that are "
                        "in the band at some speed")  # fmt: skip
    parser.add_argument(
        "--orders",
        help="multiples of the speed that excite, 1,2; default in the frame at rest 1, an "
        "unbalance; in the frame that turns 0,1: an unbalance, and a load that keeps its "
        "direction in space",
    )
    parser.add_argument(
        "-o", "--output", type=Path, help="picture (.png, .svg, .pdf) or table (.csv)"
    )


def _numbers(option: str, words: str) -> list[float]:
    try:
        return [float(word) for word in words.split(",")]
    except ValueError:
        raise BodyError(f"{option} {words}: expected numbers with commas between them") from None


def _table(diagram: Campbell) -> str:
    lines = ["speed [rad/s],mode,frequency [Hz],damping ratio,whirl"]
    for i, speed in enumerate(diagram.speeds):
        for k in range(diagram.omega.shape[1]):
            hz = diagram.omega[i, k] / 6.283185307179586
            damping, whirl = diagram.damping[i, k], diagram.whirl[i, k]
            lines.append(f"{speed:.9g},{k + 1},{hz:.9g},{damping:.6g},{whirl:.4f}")
    return "\n".join(lines) + "\n"


def _words(diagram: Campbell, one: CriticalSpeed) -> str:
    """Which mode it is, how it whirls, and what excites it."""
    import numpy as np

    if not one.order:
        return f"mode {one.mode + 1} meets 0 Hz, where an unbalance excites it"
    whirl = np.interp(one.speed, diagram.speeds, diagram.whirl[:, one.mode])
    sense = ", forward" if whirl > 0.1 else ", backward" if whirl < -0.1 else ""
    words = f"mode {one.mode + 1} at {one.order:g} times the speed{sense}"
    if one.order != 1:
        return words
    load = "a load that keeps its direction in space" if diagram.turning else "an unbalance"
    return f"{words}, where {load} may excite it"


def run_campbell(options: argparse.Namespace) -> None:
    import numpy as np

    from flexgram.model.campbell import campbell
    from flexgram.reduced_model import ReducedModel

    suffix = options.output.suffix.lower() if options.output else ""
    if options.output and suffix not in (*PICTURES, ".csv"):
        raise BodyError(f"-o {options.output}: .png, .svg, .pdf or .csv")
    if options.output:
        expect_kept(options.output, options.rom)
    model = ReducedModel.load(options.rom)
    speeds = None
    if options.speeds:
        given = _numbers("--speeds", options.speeds)
        if len(given) not in (2, 3) or (len(given) == 3 and given[2] < 2):
            raise BodyError(f"--speeds {options.speeds}: expected FROM,TO or FROM,TO,COUNT")
        speeds = np.linspace(given[0], given[1], int(given[2]) if len(given) == 3 else 61)
    given_orders = _numbers("--orders", options.orders) if options.orders else None
    diagram = campbell(model.system, speeds, options.modes)
    if options.modes is None:
        below = np.where(np.isnan(diagram.omega), np.inf, diagram.omega) <= model.claim.band[-1]
        inside = np.flatnonzero(below.any(axis=0))
        diagram = diagram.of_modes(inside if len(inside) else [0])
    orders = given_orders or ([0.0, 1.0] if diagram.turning else [1.0])
    frame = "seen in the frame that turns with the body" if diagram.turning else "frame at rest"
    say(f"  natural frequencies [Hz], {frame}; + forward, - backward; of the reduced body")
    shown = diagram.speeds[:: max(1, (len(diagram.speeds) - 1) // 6)]
    say("  rad/s      " + " ".join(f"{speed:11.5g}" for speed in shown))
    for k in range(diagram.omega.shape[1]):
        words = []
        for speed in shown:
            i = int(np.flatnonzero(diagram.speeds == speed)[0])
            whirl = diagram.whirl[i, k]
            sign = "+" if whirl > 0.1 else "-" if whirl < -0.1 else " "
            hz = diagram.omega[i, k] / (2 * np.pi)
            words.append(f"{hz:10.5g}{sign}" if np.isfinite(hz) else f"{'none':>10} ")
        say(f"  mode {k + 1:3d}   " + " ".join(words))
    for one in diagram.critical(orders):
        say(
            f"  critical speed {one.speed:.5g} rad/s ({one.speed * 30 / np.pi:.5g} rpm): "
            f"{_words(diagram, one)}"
        )
    if diagram.unstable is not None:
        worst = int(np.argmax(diagram.growth))
        most, seconds = diagram.speeds[worst], 1 / diagram.growth[worst]
        say(
            f"  unstable from {diagram.unstable:.5g} rad/s on; at {most:.5g} rad/s a motion grows "
            f"by e in {seconds:.3g} s"
        )
    if not options.output:
        return
    if suffix == ".csv":
        with written_aside(options.output) as place:
            Path(place).write_text(_table(diagram))
    else:
        from flexgram.pictures.figures import campbell as draw
        from flexgram.pictures.figures import save

        save(draw(diagram, orders, model.claim.band[[0, -1]]), options.output)
    say(f"  wrote {options.output}")
