"""`casashell ribbon` as the command line has it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from casashell.app import options as opt
from casashell.app import simulate_options as sim
from casashell.app.failures import CommandError, command

HELP: Final = (
    "Let time pass for inextensible strips: paper, satin, Moebius bands, chains of loops.\n\n"
    "SCENE is a scene file, or the name of a built-in scene (--list). Writes frames.npz, "
    "ribbon.json, player.html and the formats asked for into DIR.\n\n"
    "Exit codes: 0 complete, 1 a step failed (frames so far written), 2 bad input (nothing "
    "written), 130 interrupted (frames so far written)."
)


def ribbon(
    scene: Annotated[
        str | None, typer.Argument(metavar="SCENE.toml|NAME", show_default=False)
    ] = None,
    list_all: Annotated[
        bool, typer.Option("--list", help="Describe the built-in scenes and how long they take.")
    ] = False,
    seconds: Annotated[
        float | None,
        typer.Option(metavar="S", help="How much time passes, s. [dim]\\[that of the scene][/dim]"),
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(metavar="H", help="Time step, s. [dim]\\[that of the scene][/dim]"),
    ] = None,
    solver: Annotated[
        str | None,
        typer.Option(
            metavar="ipopt|augmented",
            help="ipopt: exact second derivatives. augmented: the method of the paper, an augmented "
            "Lagrangian around L-BFGS-B. [dim]\\[that of the scene, or ipopt][/dim]",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", rich_help_panel="Output", help="Folder. [dim]\\[SCENE-ribbon][/dim]"
        ),
    ] = None,
    force: opt.Force = False,
    resume: sim.Resume = False,
    formats: sim.Formats = "html",
    quiet: opt.Quiet = False,
    as_json: opt.Json = False,
    debug: opt.Debug = False,
) -> None:
    """The command; `HELP` is what it says about itself."""
    with command(debug):
        from casashell.app.ribbon_run import RibbonOptions, list_scenes, run_ribbon

        if list_all:
            list_scenes(as_json=as_json)
            raise typer.Exit
        if scene is None:
            raise CommandError(
                "give a scene file or the name of a built-in scene; --list shows them"
            )
        code = run_ribbon(
            RibbonOptions(
                scene,
                *(out, seconds, step, solver, formats),
                force=force,
                resume=resume,
                quiet=quiet,
                as_json=as_json,
            )
        )
    raise typer.Exit(code)
