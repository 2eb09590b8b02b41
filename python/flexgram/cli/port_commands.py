"""The verbs that work on reduced files by their ports and modes: couple, frf, modes, hotspots."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from flexgram.basics import BodyError, Floats, check_name, counted, say, written_aside

if TYPE_CHECKING:
    from flexgram.reduced_model import ReducedModel


def count_of(option: str, count: float) -> int:
    """A number of points of an option first,last,count."""
    if not (count >= 1 and count == int(count)):
        raise BodyError(f"{option}: the count {count:g} must be a whole number from 1")
    return int(count)


def couple_options(parser: argparse.ArgumentParser) -> None:
    from flexgram.assembly.couple import PORTS

    where = "PART.INTERFACE=PART.INTERFACE"
    parser.add_argument(
        "roms",
        nargs="+",
        metavar="[NAME=]ROM",
        help="reduced files; a part's name is its file's up to the first dot",
    )
    parser.add_argument(
        "--join",
        action="append",
        default=[],
        metavar=f"{where}[:x,y,...]",
        help=f"tie two interfaces (or one and ground), in all directions of "
        f"{', '.join(PORTS)} or some",
    )
    for what, unit in (("spring", "[N/m], [N m/rad]"), ("damper", "[N s/m], [N m s/rad]")):
        parser.add_argument(
            f"--{what}",
            action="append",
            default=[],
            metavar=f"{where}:x=1e6,...",
            help=f"between them, {unit} by direction; x=1e6..3e6: a range"
            + ("; loss=0.1 among them: their loss factor" if what == "spring" else ""),
        )
    parser.add_argument(
        "--turn",
        action="append",
        default=[],
        metavar="PART=RX,RY,RZ",
        help="rotation vector of a part in the assembly [degrees]",
    )
    parser.add_argument(
        "--keep",
        action="append",
        default=[],
        metavar="PART.INTERFACE",
        help="a joined interface whose ports stay",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="reduced file to write")


def run_couple(options: argparse.Namespace) -> None:
    import numpy as np

    from flexgram.assembly.couple import couple, read_joint
    from flexgram.importers.interfaces import numbers
    from flexgram.reduced_model import ReducedModel

    models: dict[str, ReducedModel] = {}
    for word in options.roms:
        name, equals, path = word.partition("=")
        file = Path(path if equals else word)
        part = check_name(f"part {word}", name if equals else file.name.partition(".")[0])
        if "." in part:
            raise BodyError(f"part {part}: without a point, which parts its ports' names")
        if part in models:
            raise BodyError(f"two parts are named {part}: name one, NAME={file}")
        models[part] = ReducedModel.load(file, basis=False)
    joints = [
        read_joint(f"--{kind}", kind, word)
        for kind in ("join", "spring", "damper")
        for word in getattr(options, kind)
    ]
    turns = {}
    for word in options.turn:
        part, _, vector = word.partition("=")
        if part in turns:
            raise BodyError(f"--turn {word}: {part} is turned twice")
        turns[part] = np.deg2rad(numbers(f"--turn {word}", vector, 3))
    whole = couple(
        models,
        joints,
        turns=turns,
        keep=options.keep,
        tell=lambda words: say(f"  proving the claim {words}"),
    )
    with written_aside(options.output, *(model.path for model in models.values())) as place:
        whole.save(place)
    for name, words in whole.provenance.plan:
        say(f"  {name:8s} {words}")
    say(f"  wrote {options.output}: order {whole.order}, {len(whole.inputs)} inputs")


def frf_options(parser: argparse.ArgumentParser) -> None:
    from flexgram.model.system import RATES

    parser.add_argument("rom", type=Path, help="reduced file")
    parser.add_argument(
        "--pair",
        action="append",
        default=[],
        metavar="OUTPUT=INPUT",
        required=True,
        help="ports, several times for more",
    )
    parser.add_argument("--hz", help="first,last,count; default: 800 over the band")
    parser.add_argument(
        "--log",
        action="store_true",
        help="frequencies with equal ratios, and a logarithmic axis",
    )
    parser.add_argument(
        "--rate", choices=RATES, default=RATES[0], help="what answers (default %(default)s)"
    )
    parser.add_argument(
        "--measured",
        type=Path,
        help="universal file (dataset 58) with one response for each --pair, in the same order: H "
        "is computed at its frequencies, and the FRAC printed",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        help=".csv, .unv (universal file 58), or a Bode plot: .png, .svg, .pdf",
    )


def run_frf(options: argparse.Namespace) -> None:
    import numpy as np

    from flexgram.importers.interfaces import numbers
    from flexgram.measured import frf
    from flexgram.reduced_model import ReducedModel

    model = ReducedModel.load(options.rom, basis=False)
    pairs = []
    for word in options.pair:
        output, equals, port = word.partition("=")
        if not equals:
            raise BodyError(f"--pair {word}: expected OUTPUT=INPUT")
        pairs.append((output, port))
    measured = frf.read_universal(options.measured) if options.measured else []
    if measured and len(measured) < len(pairs):
        raise BodyError(f"{options.measured} has {len(measured)} responses for {len(pairs)} pairs")
    if options.hz:
        first, last, count = numbers(f"--hz {options.hz}", options.hz, 3)
        count = count_of(f"--hz {options.hz}", count)
    else:
        first, last, count = *(model.claim.band[[0, -1]] / (2 * np.pi)), 800
    if options.log and not (first > 0 and last > 0):
        raise BodyError(
            f"--log from {first:g} to {last:g} Hz: name a first frequency above 0 (--hz 1,500,800)"
        )
    hertz = (np.geomspace if options.log else np.linspace)(first, last, count)
    functions = []
    for k, pair in enumerate(pairs):
        at = measured[k].hertz if measured and not options.hz else hertz
        functions += frf.responses(model, [pair], at, options.rate)
        if measured and not options.hz:
            if measured[k].rate != options.rate:
                raise BodyError(
                    f"{options.measured}: response {k + 1} is a {measured[k].rate}: "
                    f"--rate {measured[k].rate}"
                )
            likeness = frf.frac(functions[-1].values, measured[k].values)
            say(f"  {pair[0]} from {pair[1]}: FRAC {likeness:.4f} with the measured one")
    suffix = options.output.suffix.lower()
    if suffix == ".csv":
        if any(not np.array_equal(r.hertz, functions[0].hertz) for r in functions):
            raise BodyError("the measured responses are at different frequencies: --hz")
        frf.write_csv(functions, options.output)
    elif suffix in (".unv", ".uff"):
        frf.write_universal(functions, options.output, model.claim.words)
    else:
        from flexgram.pictures.figures import save

        save(frf.bode(functions, measured[: len(pairs)], options.log), options.output)
    say(f"  wrote {options.output}: {counted(len(functions), 'response')}, {model.claim.words}")


def modes_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rom", type=Path, help="reduced file, or with --band a body file")
    parser.add_argument(
        "--band",
        metavar="FIRST,LAST",
        help="of a body that is not reduced: its modes from here to there [Hz], all of them",
    )
    parser.add_argument(
        "--measured",
        type=Path,
        help="universal file (55, and 15 or 2411 for its nodes) of a test: how its "
        "modes compare (MAC)",
    )
    parser.add_argument(
        "--hz", type=float, help="largest frequency [Hz]; default: the end of the band"
    )
    parser.add_argument(
        "--body", type=Path, help="body file with the mesh; default: the one that was reduced"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        help=".unv (universal file: nodes and shapes), .csv, or with --measured a picture of the "
        "MAC: .png, .svg, .pdf",
    )


def _modes_of_body(path: Path, band: str) -> tuple[ReducedModel, Floats, tuple[float, float]]:
    """The modes of a body below the end of a band as a reduced body, how much lower at most,
    relative, each frequency of the body is in the band, and this [Hz]."""
    import os
    import warnings

    import numpy as np

    from flexgram.basics import ReductionWarning
    from flexgram.importers.interfaces import numbers
    from flexgram.reduction.medium import certify

    if int(os.environ.get("OMPI_COMM_WORLD_SIZE", "1")) > 1:
        raise BodyError("modes of a body take one process: leave mpirun out")
    first, last = numbers("--band", band, 2).tolist()
    if not 0 <= first < last:
        raise BodyError(f"--band {band}: expected first,last in ascending order")
    # Modes alone are wanted: where a free body cannot begin at 0 Hz, the band may begin above.
    medium = certify(path, (max(first, 0.01 * last), last), 0.1)
    hertz = medium.mode_omega / (2 * np.pi)
    inside = (hertz >= first) & (hertz <= last)
    if not inside.any():
        beyond = hertz[hertz > last]
        raise BodyError(
            f"{path}: no elastic mode from {first:g} to {last:g} Hz"
            + (f"; the next one is at {beyond.min():.6g} Hz" if len(beyond) else "")
            + (f"; {medium.rigid_modes} rigid ones are at 0 Hz" if medium.rigid_modes else "")
        )
    with warnings.catch_warnings():  # nobody looks at its H
        warnings.simplefilter("ignore", ReductionWarning)
        model = medium.reduce(order=medium.rigid_modes + medium.modes, method="modal")
    if model.system.terms:
        raise BodyError(
            f"{path}: its stiffness varies over frequency, with parameters or a speed: reduce it, "
            "and take the modes of the reduced body"
        )
    return model, medium.mode_error[inside], (first, last)


def _is_body(path: Path) -> bool:
    import h5py

    try:
        with h5py.File(path) as file:
            return "error" not in file and ("mesh" in file or "K" in file)
    except OSError:
        return False


def run_modes(options: argparse.Namespace) -> None:
    import numpy as np

    from flexgram.measured import mode_shapes as ms
    from flexgram.reduced_model import ReducedModel

    suffix = options.output.suffix.lower() if options.output else ""
    if options.output and suffix not in (".csv", ".unv", ".uff") and not options.measured:
        raise BodyError(
            f"-o {options.output}: .unv or .csv; a picture is of the MAC and needs "
            "--measured (of the shapes: flexgram plot --figure shapes)"
        )
    error = np.empty(0)
    if options.band is None and _is_body(options.rom):
        raise BodyError(
            f"{options.rom} is a body that is not reduced: name the band of its modes (--band "
            "10,500)"
        )
    if options.band is None:
        model = ReducedModel.load(options.rom)
    else:
        model, error, ends = _modes_of_body(options.rom, options.band)
    shapes = bool(options.measured) or suffix in (".unv", ".uff")
    modes = ms.mode_shapes(model, options.body, options.hz, at_nodes=shapes)
    band = model.claim.band / (2 * np.pi) if options.band is None else np.array(ends)
    if now := {name: law.value for name, law in model.system.parameters.items()}:
        say(f"  with {', '.join(f'{name} = {value:g}' for name, value in now.items())}")
    for k, (f, zeta) in enumerate(zip(modes.hertz, modes.damping, strict=True), 1):
        beyond = "" if band[0] <= f <= band[-1] else "  outside the band"
        beyond += ": of the reduced body only" if beyond and options.band is None else ""
        masses = ""
        if modes.effective_mass is not None:
            own = " ".join(f"{x:10.4g}" for x in modes.effective_mass[k - 1])
            masses = f"   effective mass {own} kg"
        say(f"  {k:4d} {f:12.6g} Hz   damping {100 * zeta:.3g} %{masses}{beyond}")
    if count := model.frame.rigid_modes:
        say(
            f"  {count} rigid modes are not among these numbers; in a report they are modes 1 to "
            f"{count}"
        )
    if modes.effective_mass is not None:
        total = " ".join(f"{x:.4g}" for x in modes.effective_mass.sum(axis=0))
        say(f"  effective mass of these modes in x, y, z: {total} kg")
    if options.band is None:
        say("  the claim is of H at the ports: modes that they hardly drive or show may be missing")
    else:
        least = f"{max(float(error.max(initial=0)), 1e-15):.1e}"
        said = f"  all modes from {band[0]:g} to {band[1]:g} Hz, counted by inertia"
        say(f"{said}; the exact ones are lower by at most {least}, relative (certified)")
    if model.system.is_gyroscopic:
        say(
            "  gyroscopic forces are left out: with them frequencies split and shapes whirl "
            "(ReducedModel.poles has the frequencies)"
        )
    elif modes.coupled > 1e-6:
        say(
            "  damping couples the modes: here are the frequencies without damping, and the "
            "damping of each mode by itself (in Python ReducedModel.poles has the coupled modes)"
        )
    found = None
    if options.measured:
        found = ms.compare(ms.read_universal(options.measured), modes)
        for line in found.words():
            say(f"  {line}")
    if not options.output:
        return
    if suffix == ".csv":
        ms.write_csv(modes, options.output)
    elif suffix in (".unv", ".uff"):
        ms.write_universal(modes, options.output, model.claim.words)
    elif found is not None:
        from flexgram.pictures.figures import save

        save(ms.picture(found), options.output)
    say(f"  wrote {options.output}: {len(modes.hertz)} modes")


def hotspots_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rom", type=Path, help="reduced file of a mesh")
    parser.add_argument("--count", type=int, default=5, help="at most so many (%(default)s)")
    parser.add_argument(
        "--apart", type=float, help="distance between any two [m]; default: size of the body/20"
    )
    parser.add_argument(
        "--input",
        action="append",
        metavar="PORT",
        help="a load to look at, several times for more; default: all but temperatures",
    )
    parser.add_argument(
        "--hz",
        type=float,
        help="at this frequency alone [Hz], 0: a constant load; default: the band",
    )
    parser.add_argument("--body", type=Path, help="body file with the mesh")


def run_hotspots(options: argparse.Namespace) -> None:
    import numpy as np

    from flexgram.model.geometry import body_of, units_of
    from flexgram.model.kinds import unit_of
    from flexgram.reduced_model import ReducedModel
    from flexgram.simulation.hot_spots import describe, hot_spots

    if options.count < 1:
        raise BodyError(f"--count {options.count} must be 1 or more")
    model = ReducedModel.load(options.rom)
    spots = hot_spots(
        model,
        options.count,
        apart=options.apart,
        body=options.body,
        inputs=options.input,
        hertz=options.hz,
    )
    for line in describe(spots, units_of(body_of(model, options.body))):
        say(line)
    cold = [name for name in model.inputs if unit_of(name, False) not in ("K", "K/m")]
    if others := set(options.input or cold) - {spot.input for spot in spots}:
        say(
            f"  note: {len(others)} loads have no place here; --count shows more places, --input "
            "those of a load"
        )
    if options.hz is None and model.frame.rigid_modes:
        say("  note: nothing holds the body: these are mostly resonances of the free body")
    ends = model.claim.bands / (2 * np.pi)
    if options.hz is not None and not any(a <= options.hz <= b for a, b in ends):
        said = ", ".join(f"{a:g} to {b:g} Hz" for a, b in ends)
        say(f"  note: the body was reduced for {said}; at {options.hz:g} Hz nothing is claimed")
