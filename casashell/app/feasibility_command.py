"""`casashell feasibility`: can this target be held at all?  Answers before the solve."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from casashell.app import options as opt
from casashell.app.failures import command, reading_input

if TYPE_CHECKING:
    from casashell.app.display import Reporter
    from casashell.inverse.feasibility import Feasibility

HELP = (
    "Say before solving whether any natural shape can hold SHELL.\n\n"
    "Proves that none can, with what would mend it (friction, pins, contacts), or finds stresses that "
    "hold it: how large they are, how much friction they use and whether they hold it stably.\n\n"
    "Exit codes: 0 feasible, 1 doubtful, unstable or too soft, 2 bad input, 3 proved infeasible."
)

Seconds = Annotated[
    float,
    typer.Option(
        "--seconds", metavar="S", min=0.1, help="Time for stability cuts and for trying pins."
    ),
]


def feasibility(
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
    seconds: Seconds = 20.0,
    quiet: opt.Quiet = False,
    as_json: opt.Json = False,
    debug: opt.Debug = False,
) -> None:
    """The command; `HELP` is what it says about itself."""
    with command(debug):
        scene = opt.SceneOptions(
            shell,
            tuple(obstacle or ()),
            tuple(plane or ()),
            *(pin, up, unit, gravity, tolerance, friction, density, stretch, bend),
        )
        code = run_feasibility(scene, repair=repair, seconds=seconds, quiet=quiet, as_json=as_json)
    raise typer.Exit(code)


def run_feasibility(
    options: opt.SceneOptions, *, repair: bool, seconds: float, quiet: bool, as_json: bool
) -> int:
    """Answer and print; the exit code."""
    from casashell.app.display import Reporter
    from casashell.contact.detect import describe
    from casashell.inverse.feasibility import feasibility as answer

    with reading_input(mended=repair):
        scene = options.spec().load(repair=repair)
        problem = scene.problem
        summary = describe(problem.contacts, scene.obstacles)
    found = answer(problem, seconds=seconds)
    if as_json:
        print(json.dumps(found.record, indent=1, allow_nan=False))
        return found.exit_code
    reporter = Reporter(quiet=quiet)
    reporter.scene(scene, summary)
    _print(found, reporter)
    return found.exit_code


def _print(found: Feasibility, reporter: Reporter) -> None:
    reporter.line()
    important = found.exit_code != 0
    reporter.line(f"{found.verdict}  ({found.seconds:.2f} s)", important=important)
    for sentence in found.summary:
        reporter.line(sentence, important=important)
