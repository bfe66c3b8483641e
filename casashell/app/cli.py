"""The command line program.  Every command imports what it needs when it runs."""

from __future__ import annotations

import sys
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated

import typer

from casashell.app import options as opt
from casashell.app.export_command import HELP as _EXPORT_HELP
from casashell.app.export_command import export
from casashell.app.failures import command
from casashell.app.feasibility_command import HELP as _FEASIBILITY_HELP
from casashell.app.feasibility_command import feasibility
from casashell.app.materials_command import materials
from casashell.app.ribbon_command import HELP as _RIBBON_HELP
from casashell.app.ribbon_command import ribbon
from casashell.app.simulate_command import HELP as _SIMULATE_HELP
from casashell.app.simulate_command import simulate

_HELP = (
    "Natural shapes of elastic shells in frictional contact.\n\n"
    "Give the shape a hat, a skirt or a page is to have when it rests on something, and the "
    "material it is made of; get the shape to make it in, so that it rests exactly as designed.\n\n"
    "[bold]casashell invert hat.obj --obstacle head.obj --unit cm[/bold]"
)
_INVERT_HELP = (
    "Find the natural shape that rests exactly as SHELL.\n\n"
    "Writes natural.obj, pose.obj, result.json, result.npz, scene.toml, pictures and report.html "
    "into one folder.\n\n"
    "Exit codes: 0 solved and certified, 1 not solved (partial result written), 2 bad input "
    "(nothing written), 3 proved impossible, 130 interrupted (best so far written)."
)

app = typer.Typer(
    name="casashell",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from casashell import __version__

        print(f"casashell {__version__}")
        raise typer.Exit


@app.callback(help=_HELP)
def program(
    version: Annotated[
        bool,
        typer.Option("--version", is_eager=True, callback=_version, help="Print the version."),
    ] = False,
) -> None:
    """Print the help of the program or hand over to a command."""


@app.command(help=_INVERT_HELP)
def invert(
    shell: opt.Shell,
    obstacle: opt.Obstacles = None,
    plane: opt.Planes = None,
    pin: opt.Pin = None,
    up: opt.Up = None,
    unit: opt.Unit = None,
    gravity: opt.GravityOption = None,
    friction: opt.Friction = None,
    tolerance: opt.Tolerance = None,
    repair: opt.Repair = False,
    density: opt.Density = None,
    stretch: opt.Stretch = None,
    bend: opt.Bend = None,
    method: opt.Method = None,
    step2: opt.Step2 = None,
    prefer: opt.Prefer = None,
    natural: opt.Natural = None,
    start: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            rich_help_panel=opt.SOLVER,
            help="Result of the same mesh to begin with: another material or weight takes less time.",
            show_default=False,
        ),
    ] = None,
    out: opt.Out = None,
    force: opt.Force = False,
    no_pictures: opt.NoPictures = False,
    quiet: opt.Quiet = False,
    as_json: opt.Json = False,
    debug: opt.Debug = False,
) -> None:
    """Solve, save, draw."""
    with command(debug):
        scene = opt.SceneOptions(
            shell,
            tuple(obstacle or ()),
            tuple(plane or ()),
            *(pin, up, unit, gravity, tolerance, friction, density, stretch, bend),
            *(method, step2, prefer, natural),
        )
        from casashell.app.invert import OutputOptions, run_invert

        output = OutputOptions(out, force, not no_pictures, quiet, as_json)
        code = run_invert(scene, output, repair=repair, start=start)
    raise typer.Exit(code)


@app.command()
def check(
    shell: opt.Shell,
    obstacle: opt.Obstacles = None,
    plane: opt.Planes = None,
    pin: opt.Pin = None,
    up: opt.Up = None,
    unit: opt.Unit = None,
    gravity: opt.GravityOption = None,
    friction: opt.Friction = None,
    tolerance: opt.Tolerance = None,
    repair: opt.Repair = False,
    density: opt.Density = None,
    stretch: opt.Stretch = None,
    bend: opt.Bend = None,
    quiet: opt.Quiet = False,
    as_json: opt.Json = False,
    debug: opt.Debug = False,
) -> None:
    """Look at a scene without solving it: mesh faults, contacts, size, mass, likely mistakes.

    Exit codes: 0 fit to be solved, 2 not.
    """
    with command(debug):
        scene = opt.SceneOptions(
            shell,
            tuple(obstacle or ()),
            tuple(plane or ()),
            *(pin, up, unit, gravity, tolerance, friction, density, stretch, bend),
        )
        from casashell.app.check import run_check

        code = run_check(scene, repair=repair, quiet=quiet, as_json=as_json)
    raise typer.Exit(code)


app.command(help=_FEASIBILITY_HELP)(feasibility)
app.command(help=_EXPORT_HELP)(export)
app.command(help=_SIMULATE_HELP)(simulate)
app.command(help=_RIBBON_HELP)(ribbon)


app.command()(materials)


@app.command()
def demo(
    out: Annotated[
        Path,
        typer.Option(metavar="DIR", help="Folder for the results."),
    ] = Path("demo-out"),
    force: opt.Force = False,
    no_pictures: opt.NoPictures = False,
    quiet: opt.Quiet = False,
    debug: opt.Debug = False,
) -> None:
    """Solve two built-in scenes, a hat on a head and a skirt on a waist."""
    with command(debug):
        from casashell.app.demo import run_demo

        code = run_demo(out, force=force, pictures=not no_pictures, quiet=quiet)
    raise typer.Exit(code)


@app.command()
def view(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a result.")],
    print_only: Annotated[
        bool, typer.Option("--print", help="Print the path of the report, open nothing.")
    ] = False,
    debug: opt.Debug = False,
) -> None:
    """Open the report of a result in the browser; made again if it is missing."""
    with command(debug):
        from casashell.app.view import run_view

        code = run_view(folder, print_only=print_only)
    raise typer.Exit(code)


def main() -> None:
    """Entry point of the program."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without our signs is no error
    app()
