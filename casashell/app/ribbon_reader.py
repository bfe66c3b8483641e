"""Scene files of ribbons in TOML: their schema, and their reader.

SI units; a ribbon is called by its number from 0, as in frames.npz; only length, width and segments
must be given:

    name = "helix"
    gravity = 9.81              # m/s2 along -up, or a vector
    up = "z"                    # x, y, z
    seconds = 2.0
    step = 0.01
    solver = "ipopt"            # ipopt, augmented (the paper)
    resample = "hermite"        # hermite, linear (the paper); default: what suits the solver
    mass = "consistent"         # consistent, lumped
    form = "velocities"         # velocities, positions (the paper); default: what suits the solver
    thickness = 0.001           # m; collisions between ribbons, with themselves and with obstacles

    [[ribbon]]
    name = "left"
    length = 0.5                # m
    width = 0.03                # m
    segments = 40
    stiffness = 2.7e-4          # D, J
    density = 0.08              # kg/m2
    ends = "clamped"            # clamped (the first quad is held), free, loop, moebius
    energy = "sadowsky"         # sadowsky (the paper), wunderlich
    margin = 0.1                # shortest edge between two rulings, in segments
    regulariser = 1e-3
    rest_angles = 0.0           # rad a crease; or one value each: "file.npz:key"
    target_rulings = 0.0        # slopes that rulings prefer; or "file.npz:key"
    clamp_crease = false        # bending in the half segment at a clamped begin
    end_crease = false          # the same at a held end
    junction = "crease"         # loops: crease, flat

    [ribbon.start]
    shape = "helix"             # flat; helix: radius, slope; circle; moebius; arrays: file
    radius = 0.02               # of the cylinder it is wound on
    slope = 0.5                 # cotangent of the angle between rulings and centreline
    file = "start.npz"          # slopes, angles (N-1,), and frame, origin, as of `RibbonState`
    origin = [0.0, 0.0, 0.0]    # begin of the centreline; or centre: mean of the centreline
    along = [1.0, 0.0, 0.0]     # direction of the centreline at its begin, and of the first ruling
    across = [0.0, 1.0, 0.0]
    velocity = [0.0, 0.0, 0.0]  # m/s, and spin [rad/s] about the centre of mass; not when clamped
    spin = [0.0, 0.0, 0.0]

    [ribbon.begin]              # a clamped begin that moves: keyframes as for casashell simulate
    motion = "hand.toml"
    [ribbon.end]                # the last quad is held too, where it starts, or moves
    motion = "other.toml"

    [[ribbon.attachment]]       # the material point s from the begin, y from the centreline, in m
    s = 0.5
    y = 0.0
    place = [0.3, 0.0, 0.0]     # default: where it starts
    times = [0.0, 1.0]          # or keyframes
    places = [[0.3, 0.0, 0.0], [0.1, 0.2, 0.0]]
    moves = [[0.0, 0.0, 0.0], [0.0, 0.1, 0.2]]  # or keyframes relative to where it starts
    until = 1.5                 # let go at that time

    [[ribbon.load]]             # dead force in N
    s = 0.5
    y = 0.0
    force = [0.0, 0.0, -0.1]    # or times, forces

    [[ribbon.guide]]            # draws normals of quads to a direction
    segments = [39]
    normal = [0.0, 0.0, 1.0]    # default: as it starts
    axis = [1.0, 0.0, 0.0]      # turns about this axis over time
    times = [0.0, 2.0]
    turns = [0.0, 3.0]
    weight = 0.1                # J

    [[obstacle]]                # plane, sphere, cylinder, cone, capsule, mesh: as in shell scenes
    kind = "plane"
    normal = [0.0, 0.0, 1.0]
    offset = 0.0
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, get_args

from casashell.app.ribbon_reader_tables import read_body
from casashell.app.ribbon_setup import RibbonSetup
from casashell.app.values import UP_VECTORS, parse_gravity
from casashell.io.obstacle_tables import read_obstacle
from casashell.io.toml_tables import Table, read_toml
from casashell.ribbon.resample import Resample
from casashell.ribbon.scene import Body, Scene
from casashell.ribbon.step import Form, Mass, Solver

_TOP: Final = (
    *("name", "gravity", "up", "seconds", "step", "solver", "resample", "mass", "form"),
    *("thickness", "ribbon", "obstacle"),
)


def read_ribbon_scene(path: Path) -> RibbonSetup:
    """The scene in a TOML file; the schema is at the top of this module.

    Raises ValueError naming file, table and key, OSError for a file that cannot be opened.
    """
    from formulations import ribbon_physics

    values = read_toml(path)
    top = Table.checked(values, str(path), _TOP)
    top.require("ribbon")
    up = UP_VECTORS[top.choice("up", tuple(UP_VECTORS), "z")]
    physics = ribbon_physics()
    names: set[str] = set()
    bodies = []
    for number, table in enumerate(_tables(top, "ribbon", path)):
        body = read_body(table, f"{path}, ribbon {number}", path.parent, number, physics)
        if body.name in names:
            raise ValueError(f"{path}, ribbon {number}: name '{body.name}' is taken")
        names.add(body.name)
        bodies.append(body)
    gravity, thickness = _gravity(top, up), _positive(top, "thickness", 0.0)
    obstacles = tuple(
        read_obstacle(table, f"{path}, obstacle {number}", path.parent, 1.0)
        for number, table in enumerate(_tables(top, "obstacle", path), start=1)
    )
    try:
        scene = Scene(tuple(bodies), physics, gravity, thickness, obstacles)
    except ValueError as problem:
        raise ValueError(f"{path}: {problem}") from None
    solver: Solver = _word(top, "solver", get_args(Solver), "ipopt")
    resample: Resample | None = _word(top, "resample", get_args(Resample), None)
    mass: Mass = _word(top, "mass", get_args(Mass), "consistent")
    form: Form | None = _word(top, "form", get_args(Form), None)
    return RibbonSetup(
        name=top.text("name", path.stem) or path.stem,
        scene=scene,
        seconds=_positive(top, "seconds", 1.0),
        step=_positive(top, "step", 0.01),
        solver=solver,
        resample=resample,
        mass=mass,
        form=form,
        up=up,
        source=_source(values, bodies),
    )


def _tables(top: Table, key: str, path: Path) -> Sequence[Any]:
    tables = top.values.get(key, [])
    if not isinstance(tables, list):
        raise ValueError(f"{path}: write every {key} under [[{key}]], in double brackets")
    return tables


def _word(top: Table, key: str, options: Sequence[str], default: Any) -> Any:
    return top.choice(key, options, "") if key in top else default


def _positive(top: Table, key: str, default: float) -> float:
    if key not in top:
        return default
    value = top.number(key)
    if value < 0.0 or (value == 0.0 and key != "thickness"):
        raise top.wrong(key, "a number > 0")
    return value


def _gravity(top: Table, up: tuple[float, float, float]) -> tuple[float, float, float]:
    given = parse_gravity(top.values.get("gravity", 9.81), f"{top.where}: gravity")
    if isinstance(given, tuple):
        return given
    x, y, z = (-given * component for component in up)
    return (x, y, z)


def _source(values: dict[str, Any], bodies: Sequence[Body]) -> str:
    """Differs when the scene does; times and title do not count.  Start shapes stand for their files."""
    kept = {key: value for key, value in values.items() if key not in ("name", "seconds", "step")}
    digest = hashlib.sha256(json.dumps(kept, sort_keys=True, default=str).encode())
    for body in bodies:
        state, ribbon = body.initial, body.ribbon
        for array in (state.slopes, state.angles, state.frame, state.origin):
            digest.update(array.tobytes())
        for field in (ribbon.rest_angles, ribbon.target_rulings):
            digest.update(memoryview(field))  # type: ignore[arg-type]
    return digest.hexdigest()
