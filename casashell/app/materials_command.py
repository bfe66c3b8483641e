"""`casashell materials` on the command line."""

from __future__ import annotations

import typer

from casashell.app import options as opt
from casashell.app.failures import command


def materials(
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
    """How soft, heavy and slippery a material may be for this target, next to real ones.

    Exit codes: 0 some material holds it, 1 none was found, 2 bad input, 130 interrupted.
    """
    with command(debug):
        scene = opt.SceneOptions(
            shell,
            tuple(obstacle or ()),
            tuple(plane or ()),
            *(pin, up, unit, gravity, tolerance, friction, density, stretch, bend),
        )
        from casashell.app.materials import run_materials  # slow to import

        code = run_materials(scene, repair=repair, quiet=quiet, as_json=as_json)
    raise typer.Exit(code)
