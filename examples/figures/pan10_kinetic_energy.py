"""Pan 2016, Fig. 10: one step of the ribbon against one step of finite elements on its own rulings.

While a helix unrolls, chosen steps are made again by triangles between the rulings that the ribbon found,
from the same two former shapes: remeshing is taken out, the motion is left.  Triangles share vertices,
hardly stretch, bend at the rulings as the ribbon does (their energy is the ribbon's to rounding), may bend
elsewhere as a plate, and have a third of their mass at each corner.
Checked: the two ends of a step are apart by less than a twentieth of the way in that step, and by less the
finer the mass is spread.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from ribbon_stage import Piece, Shot, panels, piece
from stage import conclude, folder

from benchmarks import ribbon_fem as fem
from casashell import TriMesh
from casashell.app.ribbon_shapes import wound
from casashell.io.colours import bending_map
from casashell.io.sheet import ColourBar, write_sheet
from casashell.ribbon import Body, Ribbon, RibbonSimulation, Scene, simulate
from formulations import ribbon_physics
from formulations.hinge_bending import hinge_bending

STRIP = Ribbon(10.0, 0.6, 16, stiffness=0.1, density=0.08)
RADIUS, SLOPE, H, SHOWN = 1.0, 0.5, 0.02, (10, 20, 30, 39)
ROWS = 8  # of triangles across


@dataclass(frozen=True)
class Step:
    """A step to ``time``: its ends by ribbon and triangles, its start (V,3).

    apart    of both ends over L;  moved, changed  the same over the way in the step, and over what forces
             and stiffness changed of it
    energy   of the triangles in the ribbon's shape over the ribbon's
    """

    time: float
    ribbon: np.ndarray
    triangles: np.ndarray
    former: np.ndarray
    faces: np.ndarray
    apart: float
    moved: float
    changed: float
    energy: float


def placed(sim: RibbonSimulation, k: int, points: np.ndarray) -> np.ndarray:
    """Where material points (n,2) (s, y) are in frame k."""
    track, (s, y) = sim.tracks[0], points.T
    at = STRIP.segment * np.arange(STRIP.segments + 1) + np.pad(track.slopes[k], 1) * y[:, None]
    up = (y / STRIP.width + 0.5)[:, None, None]
    ruled = (1.0 - up) * track.bottom[k] + up * track.top[k]
    found = [[np.interp(a, b, line[:, i]) for i in range(3)] for a, b, line in zip(s, at, ruled)]
    return np.array(found)


def mesh_of(slopes: np.ndarray, rows: int) -> TriMesh:
    """The flat strip, cells between rulings and lines along it; vertex i (rows + 1) + j."""
    y = np.linspace(-0.5, 0.5, rows + 1) * STRIP.width
    s = STRIP.segment * np.arange(STRIP.segments + 1)[:, None] + np.pad(slopes, 1)[:, None] * y
    flat = np.stack([s, np.broadcast_to(y, s.shape), 0.0 * s], axis=2).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(range(STRIP.segments), range(rows), indexing="ij"))
    a = i * (rows + 1) + j
    b, c, d = a + rows + 1, a + rows + 2, a + 1
    return TriMesh(flat, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def again(sim: RibbonSimulation, n: int, rows: int = ROWS) -> Step:
    """The step from frame n to n + 1 by triangles."""
    mesh = mesh_of(sim.tracks[0].slopes[n + 1], rows)
    before, now, then = (placed(sim, k, mesh.vertices[:, :2]) for k in (n - 1, n, n + 1))
    clamp = fem.Hold(np.arange(2 * (rows + 1)))
    patch = fem.Patch(mesh, STRIP.stiffness, STRIP.density, holds=(clamp,))
    # A ruling stands for a length l of the strip, however the triangles beside it are cut.
    ends = mesh.hinges
    corner = mesh.vertices[ends] - mesh.vertices[ends[:, :1]]
    area = sum(0.5 * np.linalg.norm(np.cross(corner[:, 1], corner[:, k]), axis=1) for k in (2, 3))
    ruling = ends[:, 0] // (rows + 1) == ends[:, 1] // (rows + 1)
    share = np.where(ruling, area * rows / (STRIP.segment * STRIP.width), 1.0)
    body = replace(
        fem.conforming(patch, bending="hinge"),
        energies=(hinge_bending(mesh, STRIP.stiffness / 3.0 * share),),
    )
    way = fem.ImplicitEuler(body)
    found = way.step(way.begin(now, (now - before) / H), H).x
    apart = float(np.linalg.norm(found - then, axis=1).max())
    moved = float(np.linalg.norm(then - now, axis=1).max())
    changed = float(np.linalg.norm(then - 2.0 * now + before, axis=1).max())
    bending = float(sim.energies[n + 1, 0, 1])
    sizes = (apart / STRIP.length, apart / moved, apart / changed, body.energy(then) / bending)
    return Step(H * (n + 1), then, found, now, mesh.faces, *sizes)


def measure(shown: tuple[int, ...] = SHOWN) -> tuple[list[Step], Step]:
    """The steps, and the last one with half as many rows."""
    scene = Scene((Body(STRIP, wound(STRIP, RADIUS, SLOPE)),), ribbon_physics(), (0.0, 0.0, 0.0))
    sim = simulate(scene, H * (shown[-1] + 1), H)
    return [again(sim, n) for n in shown], again(sim, shown[-1], ROWS // 2)


def complaints(steps: list[Step], coarse: Step) -> list[str]:
    wrong = [
        f"t = {step.time:g} s: apart by {step.moved:.1%} of the way"
        for step in steps
        if step.moved > 0.05
    ]
    if any(abs(step.energy - 1.0) > 1e-4 for step in steps):
        wrong.append("triangles and ribbon have different energies in the same shape")
    if coarse.apart < steps[-1].apart:
        wrong.append("more rows of triangles are further from the ribbon")
    return wrong


def draw(steps: list[Step], path: Path) -> None:
    away = [np.linalg.norm(s.triangles - s.ribbon, axis=1) / STRIP.length for s in steps]
    colours = bending_map(np.concatenate(away))
    bar, shots = ColourBar(colours, "distance from the ribbon", "1e-5 L", 1e5), []
    for step, off in zip(steps, away):
        edge = np.arange(len(step.ribbon)).reshape(-1, ROWS + 1)
        former = piece(step.former[edge[:, 0]], step.former[edge[:, -1]])
        triangles = Piece(step.triangles, step.faces, former.lines, colours.rgb(off))
        label = f"t = {step.time:g} s: {step.moved:.1%} of the step apart"
        shots.append(Shot(label, [triangles], bar))
    made = panels(shots, view=(40.0, 25.0), height=520)
    write_sheet([made[:2], made[2:]], path)


if __name__ == "__main__":
    out, (steps, coarse) = folder(__doc__), measure()
    draw(steps, out / "pan10_kinetic_energy.png")
    lines = [
        f"t = {step.time:g} s, {len(step.faces)} triangles: ends {step.apart:.1e} L apart, "
        f"{step.moved:.1%} of the way and {step.changed:.1%} of what forces changed in it"
        for step in [*steps, coarse]
    ]
    conclude(lines, complaints(steps, coarse))
