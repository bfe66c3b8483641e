"""Scene files in TOML: their schema, and their reader.

Lengths are in the file's own unit, paths relative to the file; everything but the shell is optional:

    name = "hat"                    # for reports
    method = "auto"                 # auto, direct, two-step, nlp, free-pose
    step2 = "ipopt"                 # ipopt, bfgs: second step of two-step
    natural = "mesh"                # mesh, metric: rest lengths and angles as well
    prefer = "flat.obj"             # natural shape to stay near: same faces, any place
    gravity = 9.81                  # m/s2 along -up, or a vector [0.0, -9.81, 0.0]
    tolerance = 0.039               # contact when signed distance < tolerance
    pinned = [3, 17, 42]            # vertex ids from 0, or a text file "pins.txt"

    [shell]
    file = "hat.obj"
    unit = "dm"                     # m, dm, cm, mm or metres per unit
    up = "y"                        # x, y, z

    [material]                      # a number, or one value per element: "file.npz:key"
    density = 0.2                   # kg/m2, per face
    stretch = 20.0                  # N, per edge
    bend = "stiffness.npz:bend"     # J, per hinge
    friction = "grip.npz:mu"        # per vertex; overrides that of the obstacles

    [[obstacle]]                    # as many as you like
    kind = "mesh"                   # file, flip = false
    file = "body.obj"
    friction = 0.5                  # every kind has friction and name

    [[obstacle]]
    kind = "plane"                  # normal, offset: free where normal . x >= offset
    normal = [0.0, 1.0, 0.0]        # sphere: center, radius      capsule: a, b, radius
    offset = 0.0                    # cylinder: base, axis, radius, length (none: infinite)
                                    # cone: apex, axis, half_angle [rad], length (none: infinite)
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from casashell.app.scene import ObstacleSource, SceneSpec
from casashell.app.values import (
    Pins,
    parse_gravity,
    parse_material,
    parse_method,
    parse_natural,
    parse_step2,
    parse_tolerance,
    parse_unit,
    parse_up,
)
from casashell.io.toml_tables import Table, read_toml

_TOP: Final = (
    *("name", "method", "step2", "natural", "prefer", "gravity", "tolerance", "pinned"),
    *("shell", "material", "obstacle"),
)


def read_scene(path: Path) -> SceneSpec:
    """The scene in a TOML file; the schema is at the top of this module.

    Raises ValueError naming file, table and key, OSError for a file that cannot be opened.
    """
    folder = path.parent
    top = Table.checked(read_toml(path), str(path), _TOP)
    top.require("shell")
    shell = Table.checked(top.values["shell"], f"{path}, [shell]", ("file", "unit", "up"))
    shell.require("file")
    where = f"{path}, [material]"
    material = Table.checked(
        top.values.get("material", {}), where, ("density", "stretch", "bend", "friction")
    )
    given: dict[str, Any] = {
        ("vertex_friction" if key == "friction" else key): parse_material(
            value, f"{where}: {key}", folder
        )
        for key, value in material.values.items()
    }
    if "gravity" in top:
        given["gravity"] = parse_gravity(top.values["gravity"], f"{path}: gravity")
    if "tolerance" in top:
        given["tolerance"] = parse_tolerance(top.values["tolerance"], f"{path}: tolerance")
    if "method" in top:
        given["method"] = parse_method(top.text("method"), f"{path}: method")
    if "step2" in top:
        given["step2"] = parse_step2(top.text("step2"), f"{path}: step2")
    if "natural" in top:
        given["natural"] = parse_natural(top.text("natural"), f"{path}: natural")
    if "prefer" in top:
        given["prefer"] = folder / top.text("prefer")
    if "unit" in shell:
        given["unit"] = parse_unit(shell.values["unit"], f"{path}, [shell]")
    if "up" in shell:
        given["up"] = parse_up(shell.text("up"), f"{path}, [shell]")
    return SceneSpec(
        shell=folder / shell.text("file"),
        name=top.text("name"),
        obstacles=_obstacle_sources(top, path),
        pinned=_pins(top, folder),
        file=path,
        **given,
    )


def _obstacle_sources(top: Table, path: Path) -> tuple[ObstacleSource, ...]:
    tables = top.values.get("obstacle", [])
    if not isinstance(tables, list):
        raise ValueError(f"{path}: write every obstacle under [[obstacle]], in double brackets")
    return tuple(
        ObstacleSource(table, f"{path}, obstacle {number}", path.parent)
        for number, table in enumerate(tables, start=1)
    )


def _pins(top: Table, folder: Path) -> Pins:
    value = top.values.get("pinned", [])
    if isinstance(value, str):
        return folder / value
    if not isinstance(value, list):
        raise top.wrong("pinned", "a list of vertex ids or the name of a text file")
    return top.whole_numbers("pinned") if value else ()
