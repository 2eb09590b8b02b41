"""``flexgram import``: a mesh, its description, or files of an FE code -> body file."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flexgram.basics import BodyError, expect_kept, say

COUPLINGS = {
    "rigid": "all nodes follow a reference node with six dofs (RBE2)",
    "distributing": "force averaging (RBE3)",
    "node": "the dofs of the nodes themselves",
    "rows": "rows of the matrices, numbers from 1: name=1,2,3, or with their directions "
    "name=fx:25,fy:26, by which couple joins them",
}


#: Endings of files that are meshes and nothing else.
MESHES = (
    ".msh",
    ".vtu",
    ".vtk",
    ".med",
    ".xdmf",
    ".xmf",
    ".exo",
    ".e",
    ".cgns",
    ".h5m",
    ".ugrid",
    ".su2",
    ".mesh",
    ".meshb",
    ".vol",
)


#: Options of files of matrices, of decks, and of any body, which YAML has in itself.
OF_FILES = (
    *("format", "deck", "mass", "damping", "inputs", "mapping"),
    *("run_ccx", "strict", "matrices"),
)
OF_DECKS = ("assemble", "step", "deck_loads", "ignore")
OF_MESHES = ("merge", "keep_repeated", "spin", "preload")
OF_BODIES = ("units", "alpha", "beta", "eta", "zeta", "load", "measure")


class _Named(argparse.Action):
    """Collects --rigid, --distributing, … in the order of the command line."""

    def __call__(self, parser: Any, namespace: Any, value: Any, option: Any = None) -> None:
        found = getattr(namespace, "interfaces", None) or []
        namespace.interfaces = [*found, (str(option).lstrip("-"), value)]


#: The options that most people use.
SHORT_HELP = """\
usage: flexgram import SOURCE [options] -o BODY

a body file, of the description of a mesh or of files of an FE code

  flexgram import meshes/rack.yaml -o out/rack.h5
  flexgram import part.inp --run-ccx --units mm-t-s --rigid left=NSET:LEFT -o part.h5
  flexgram import lever.msh --material steel --units mm-t-s --rigid eye=NSET:eye -o lever.h5

  SOURCE                     YAML description, mesh (with --material), or file of an FE code
  -o BODY                    body file to write
  --rigid NAME=WHERE         interface: all nodes follow a reference with six dofs (RBE2)
  --node NAME=WHERE          interface: the dofs of the nodes themselves
  --support NAME=WHERE       nodes of a mesh that the ground holds
  --material NAME            of a mesh: steel, aluminium, titanium, cast-iron, or
                             E=210e9,nu=0.3,rho=7850
  --units UNITS              of the files: SI [default], mm-t-s, mm-kg-s, in-lbf-s, ft-lbf-s
  --alpha A, --beta B        damping αM + βK [1/s, s]
  --zeta RATIO,HZ,HZ         the same by a damping ratio at two frequencies: 1%,50,2000
  --eta ETA                  loss factor
  --run-ccx                  run CalculiX on the deck first
  --assemble                 assemble a deck of CalculiX or Abaqus, or Nastran's bulk data, here
  --help-all                 all options: loads, outputs, preload, spin, matrices, steps, ...

WHERE is NSET:SET, NODES:1,2,3, BOX:x0,y0,z0,x1,y1,z1 or AT:x,y,z, in the units of the files.
"""


def import_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        type=Path,
        help="YAML description of a mesh, a mesh (.msh, .vtu, .med, with --material), or a file "
        "of an FE code: job.inp, job.sti (CalculiX), job_STIF1.mtx (Abaqus), .pch, .op4 "
        "(Nastran), .full (ANSYS), .mat, .mtx (MatrixMarket), PETSc binary",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="body file to write")
    from flexgram.importers import FORMATS  # light: NumPy and SciPy

    parser.add_argument("--format", choices=FORMATS, help="default: by the file's name")
    parser.add_argument("--deck", type=Path, help="model with nodes and node sets")
    parser.add_argument("--mass", type=Path, help="mass matrix, where the source holds K only")
    parser.add_argument("--damping", type=Path, help="damping matrix in a file of its own")
    parser.add_argument(
        "--inputs",
        type=Path,
        help="input matrix B in a file of its own (PETSc, MatrixMarket, text)",
    )
    parser.add_argument(
        "--matrices",
        metavar="K=KXX,M=MXX",
        help="names of the matrices in an OP4, DMIG or MATLAB file, where not the usual ones",
    )
    parser.add_argument("--mapping", type=Path, help="ANSYS node map of HBMAT or *EXPORT")
    parser.add_argument(
        "--run-ccx",
        action="store_true",
        help="run CalculiX on the deck first: its *FREQUENCY step, or one in place of its steps, "
        "stores the matrices",
    )
    parser.add_argument(
        "--assemble",
        action="store_true",
        help="assemble a CalculiX or Abaqus deck (without ccx and its printed digits) or Nastran "
        "bulk data (.bdf, .nas, .dat) here: solids, shells, beams, point masses, springs, rigid "
        "bodies, ties; --format abaqus where a deck means something else for CalculiX",
    )
    parser.add_argument(
        "--ignore",
        metavar="CARD",
        action="append",
        default=[],
        help="with --assemble, of Nastran bulk data: a card to pass over though it may say "
        "something of stiffness or mass",
    )
    parser.add_argument(
        "--step",
        type=int,
        help="with --run-ccx or --assemble: which *FREQUENCY step (1, 2, …); default: the last "
        "with PERTURBATION, else the first",
    )
    parser.add_argument(
        "--deck-loads",
        action="store_true",
        help="make inputs of the loads of a CalculiX deck's steps (*CLOAD, *DLOAD, *DSLOAD; with "
        "--assemble *TEMPERATURE), or of the cases of Nastran bulk data (LOAD, TEMPERATURE): 1 is "
        "what the deck says",
    )
    parser.add_argument(
        "--strict", action="store_true", help="refuse files of which something is left out"
    )
    for coupling, what in COUPLINGS.items():
        parser.add_argument(
            f"--{coupling}", metavar="NAME=WHERE", action=_Named, help=f"interface: {what}"
        )
    parser.add_argument(
        "--support",
        metavar="NAME=[x,y,…:]WHERE",
        action="append",
        default=[],
        help="where the ground holds a mesh without YAML, in some directions (x, y, z, rx, ry, rz) "
        "or all: foot=NSET:foot, guide=y,z:NSET:rail",
    )
    parser.add_argument(
        "--load",
        metavar="NAME=TYPE[:MORE]",
        action="append",
        default=[],
        help="input beside the interfaces, of a mesh or with --assemble: gravity=acceleration, "
        "weight=acceleration:0,0,-9810 (units of the mesh), gas=pressure:NSET:piston, "
        "wind=traction:WHERE, push=force:WHERE, turn=spin:x,y,z,ax,ay,az (point, axis), "
        "swing=angular_acceleration:x,y,z, warm=temperature:WHERE, "
        "pull=nodal:table.csv (node, fx, fy, fz[, mx, my, mz])",
    )
    parser.add_argument(
        "--measure",
        metavar="NAME=[KIND:]WHERE",
        action="append",
        default=[],
        help="output beside the interfaces, likewise and of a CalculiX deck's matrices: mean "
        "displacement of nodes; stress:WHERE or stress:ELEMENTS:5,6[@POINT], a point of the "
        "integration; gauge:x,y,z:WHERE, the strain along a direction, a rosette with the normal "
        "of the surface, gauge:x,y,z/nx,ny,nz:WHERE; of shells with a side, stress/top: and "
        "gauge/bottom:; reaction:WHERE, the force by which supports hold nodes (not of matrices)",
    )
    parser.add_argument(
        "--preload",
        metavar="INPUT=VALUE",
        action="append",
        default=[],
        help="an input that stays while the body vibrates, and how much of it, in SI units: "
        "pull.fx=2e4, turn.spin=9e4 (speed squared), step1_cload.load=1 (with --deck-loads); of a "
        "mesh or with --assemble",
    )
    parser.add_argument(
        "--spin",
        metavar="X,Y,Z,AX,AY,AZ:FROM,TO[:rest]",
        help="the body turns about an axis (point, direction), at a speed between two [rpm]; seen "
        "in the frame that turns, or (solids of revolution, shafts of beams) at rest; likewise",
    )
    parser.add_argument(
        "--material",
        help="of a mesh without YAML: steel, aluminium, titanium, cast-iron, or "
        "E=210e9,nu=0.3,rho=7850 in its units",
    )
    parser.add_argument(
        "--thickness",
        type=float,
        help="of a mesh of shells (triangles, quadrilaterals) with --material, in its units",
    )
    parser.add_argument(
        "--merge",
        type=float,
        metavar="TOL",
        help="of a mesh or with --assemble: nodes no farther apart than TOL (its units) are one",
    )
    parser.add_argument(
        "--keep-repeated",
        action="store_true",
        help="likewise: elements that have the same nodes count each; default: they are refused",
    )
    parser.add_argument(
        "--units",
        help="of the files: SI (default), mm-t-s, mm-kg-s, in-lbf-s, ft-lbf-s (mass in slugs)",
    )
    parser.add_argument(
        "--zeta",
        metavar="RATIO,HZ,HZ",
        help="damping ratio at two frequencies, as alpha and beta: 1%%,50,2000 (less between "
        "them, more outside)",
    )
    for name, unit in (("alpha", "[1/s]"), ("beta", "[s]"), ("eta", "loss factor")):
        parser.add_argument(f"--{name}", type=float, help=f"damping {unit}")


def _names(words: str | None) -> dict[str, str] | None:
    """``K=KXX,M=MXX`` as a mapping."""
    if words is None:
        return None
    pairs = [word.partition("=") for word in words.split(",")]
    if not all(role.strip() and name.strip() for role, _, name in pairs):
        raise BodyError(f"--matrices {words}: expected K=NAME,M=NAME")
    return {role.strip().upper(): name.strip() for role, _, name in pairs}


def _refuse(options: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Refuse options that mean nothing here; ``why`` stands behind the option's name."""
    for name in names:
        if getattr(options, name):
            raise BodyError(f"--{name.replace('_', '-')}{why}")


def _import_description(options: argparse.Namespace, named: list[tuple[str, str]]) -> None:
    """A YAML description."""
    from flexgram.body.description import import_body
    from flexgram.cli.import_words import say_mesh

    why = (
        ": interfaces, units and damping of a meshed body stand in its YAML file "
        f"{options.source}, not on the command line"
    )
    own = ("material", "thickness", "support")
    _refuse(options, (*own, *OF_FILES, *OF_DECKS, *OF_MESHES, *OF_BODIES), why)
    for coupling, _ in named:
        raise BodyError(f"--{coupling}{why}")
    say_mesh(options.output, import_body(options.source, options.output))


def _import_mesh(options: argparse.Namespace, named: list[tuple[str, str]]) -> None:
    """A mesh of one material, described on the command line."""
    from flexgram.cli.import_words import say_mesh
    from flexgram.importers import parse
    from flexgram.importers.mesh import describe_supports, import_mesh

    if options.material is None:
        raise BodyError(
            f"{options.source} is a mesh: name what it is made of and its interfaces (--material "
            "steel --rigid eye=NSET:EYE), or describe it in YAML (several materials, beams), "
            "see meshes/rack.yaml"
        )
    _refuse(options, OF_FILES, " is nothing for a mesh")
    _refuse(options, OF_DECKS, " is of decks, which name their materials, and --material of meshes")
    counts = import_mesh(
        options.source,
        options.output,
        options.material,
        [parse(*pair) for pair in named],
        **_of_body(options),
        **_further(options),
        **_of_mesh(options),
        supports=describe_supports(options.support, options.thickness is not None),
        thickness=options.thickness,
    )
    say_mesh(options.output, counts)


def _import_deck(options: argparse.Namespace, named: list[tuple[str, str]]) -> None:
    """A CalculiX deck or Nastran bulk data, assembled here."""
    from flexgram.cli.import_words import say_mesh
    from flexgram.importers import parse
    from flexgram.importers.decks import BULK_DATA, import_deck

    _refuse(
        options,
        ("mass",),
        " is a file with a mass matrix; a point mass is *MASS or CONM2 in the deck, or masses: in "
        "a YAML description (docs/connections.md)",
    )
    others = [key for key in OF_FILES if key not in ("format", "mass")]
    _refuse(options, ("thickness", *others), " is nothing for --assemble")
    _refuse(options, ("support",), ": write what holds the body into the deck (*BOUNDARY, SPC)")
    interfaces = [parse(*pair) for pair in named]
    more = {**_of_body(options), **_further(options), **_of_mesh(options)}
    if options.source.suffix.lower() in BULK_DATA:
        _refuse(options, ("step",), " is of CalculiX decks")
    else:
        _refuse(options, ("ignore",), " is of Nastran bulk data")
    counts = import_deck(
        options.source,
        options.output,
        interfaces,
        step=options.step,
        ignore=options.ignore,
        deck_loads=options.deck_loads,
        abaqus=options.format == "abaqus",
        **more,
    )
    say_mesh(options.output, counts)
    for remark in counts["remarks"]:
        say(f"  note: {remark}")


def _import_files(options: argparse.Namespace, named: list[tuple[str, str]]) -> None:
    """Matrices of an FE code."""
    from flexgram.cli.import_words import say_damping, say_matrices
    from flexgram.importers import check_damping, import_matrices, parse, read

    _refuse(options, OF_MESHES, " is for bodies that flexgram assembles")
    _refuse(options, ("support",), " is of meshes: these matrices are held already, or free")
    if options.load:
        raise BodyError(
            "--load is for bodies that flexgram assembles: a mesh, or a CalculiX deck with "
            "--assemble (--deck-loads takes those of the deck's steps)"
        )
    interfaces = [parse(*pair) for pair in named]  # before ccx runs for minutes
    check_damping(options.alpha, options.beta, options.eta)
    if options.run_ccx:
        say(f"  ccx runs on {options.source}")
    fe = read(
        options.source,
        format=options.format,
        deck=options.deck,
        mass=options.mass,
        damping=options.damping,
        inputs=options.inputs,
        mapping=options.mapping,
        run_ccx=options.run_ccx,
        step=options.step,
        deck_loads=options.deck_loads,
        matrices=_names(options.matrices),
    )
    facts = import_matrices(
        fe,
        options.output,
        interfaces,
        strict=options.strict,
        outputs=_further(options)["outputs"],
        **_of_body(options),
    )
    say_matrices(options.output, facts)
    say_damping(facts)


def _of_body(options: argparse.Namespace) -> dict[str, Any]:
    """Units and damping."""
    given = {name: getattr(options, name) for name in ("alpha", "beta", "eta")}
    if options.zeta is not None:
        from flexgram.body.damping import by_ratio

        given["alpha"], given["beta"] = by_ratio(
            options.zeta, given["alpha"], given["beta"], "--zeta"
        )
    return {"units": options.units or "SI", **given}


def _of_mesh(options: argparse.Namespace) -> dict[str, Any]:
    """What is to be done with its nodes and elements."""
    from flexgram.importers.mesh import describe_preload, describe_spin

    return {
        "merge": options.merge,
        "keep_repeated": options.keep_repeated,
        "spin": describe_spin(options.spin) if options.spin else None,
        "preload": describe_preload(options.preload) or None,
    }


def _further(options: argparse.Namespace) -> dict[str, Any]:
    """Loads and outputs of the command line."""
    from flexgram.importers.mesh import describe_load, describe_output

    found: dict[str, dict[str, Any]] = {"loads": {}, "outputs": {}}
    for key, words, read in (
        ("loads", options.load, describe_load),
        ("outputs", options.measure, describe_output),
    ):
        for word in words:
            name, entry = read(word)
            if name in found[key]:
                raise BodyError(f"{key[:-1]} {name} is given twice")
            found[key][name] = entry
    return found


def _inputs(options: argparse.Namespace) -> list[Path]:
    """Files that are read beside those that options name: includes of decks, tables of loads."""
    from flexgram.importers.deck import files_of

    decks = [p for p in (options.source, options.deck) if p and p.suffix.lower() == ".inp"]
    tables = [w.split(":", 1)[1] for w in options.load if w.partition("=")[2].startswith("nodal:")]
    return [file for deck in decks for file in files_of(deck)] + [Path(t) for t in tables]


def _expect_no_result(path: Path) -> None:
    """A body file replaces a body file, and no reduced file, whose name it was given by mistake."""
    import h5py

    try:
        with h5py.File(path) as file:
            is_result = "error" in file or "projected" in file
    except OSError:  # no HDF5, or what a killed import left
        return
    if is_result:
        raise BodyError(f"{path} is a reduced file or a medium model; name another body file")


def import_body_file(options: argparse.Namespace) -> None:
    """The verb: by the source and the options, one of four ways."""
    named = getattr(options, "interfaces", None) or []
    ending = options.source.suffix.lower()
    if options.output.exists():
        expect_kept(options.output, *_inputs(options))
        _expect_no_result(options.output)
    from flexgram.body.meshfile import REMEDIES

    if ending in REMEDIES:
        raise BodyError(f"{options.source}: {REMEDIES[ending]}")
    if ending in (".yaml", ".yml"):
        _import_description(options, named)
    elif options.material is not None or ending in MESHES:
        _import_mesh(options, named)
    elif options.assemble:
        _import_deck(options, named)
    else:
        _import_files(options, named)
