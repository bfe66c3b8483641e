"""Ly 2018, Fig. 13: a skirt that touches the ground, and which of its many natural shapes is found.

The skirt of Fig. 6 hangs around its cone; the ground rises under it until the hem has come to rest there,
with friction.  The flat ring is a natural shape of that pose, but Step 1 holds the contacts and finds
another.  Checked: without ground the shape found is flatter than with it; with the ring as the shape to
stay near (`prefer=`), the same pose gives the ring back.
"""

from dataclasses import replace

import numpy as np
from skirt_released import target
from stage import Pose, conclude, folder, panels

from casashell import Plane, Result, RigidMotion, simulate, solve
from casashell.app.scene import Scene
from casashell.dynamics.simulate import Damping
from casashell.io.sheet import write_sheet
from casashell.strain import strain

RISE = 0.03  # m
ORANGE = ("#e0a95c", "#b9833b")


def ring() -> np.ndarray:
    """The flat ring (200,3) m."""
    row, place = np.divmod(np.arange(200), 20)
    angle, out = 2.0 * np.pi * (place + 0.5 * (row % 2)) / 20.0, 0.2 + 0.7 * row / 9.0
    return np.stack([out * np.sin(angle), 0.0 * out, out * np.cos(angle)], axis=1)


def grounded(scene: Scene) -> Scene:
    """The skirt at rest on the cone and on a ground that has risen under it."""
    low = float(scene.target.vertices[:, 1].min())
    ground = Plane((0.0, 1.0, 0.0), low - 1e-4, friction=0.6, name="ground")
    hung = replace(scene, obstacles=(*scene.obstacles, ground))
    rises = RigidMotion([0.0, 1.0], translation=[[0.0, 0.0, 0.0], [0.0, RISE, 0.0]])
    result = solve(hung.problem, prefer=ring())
    calm = Damping(mass=4.0, stiffness=5e-3)
    run = simulate(result, 8.0, rest=ring(), motion={"ground": rises}, damping=calm)
    print(f"on the ground: {run.status}, {run.speeds[-1]:.1e} m/s")
    risen = replace(ground, offset=low - 1e-4 + RISE)
    pose = scene.target.moved(run.positions[-1])
    return replace(scene, target=pose, obstacles=(*scene.obstacles, risen), tolerance=1e-6)


def measure() -> tuple[Scene, dict[str, Result]]:
    """The skirt on the ground, and three results."""
    hung = target(5e-3)
    scene = grounded(hung)
    return scene, {
        "no ground": solve(hung.problem, "two-step").require(),
        "ground": solve(scene.problem, "two-step").require(),
        "near the ring": solve(scene.problem, prefer=ring()).require(),
    }


def bent(result: Result) -> float:
    """Mean bending of a natural shape against the flat ring [degrees]."""
    return float(np.degrees(strain(result.target.moved(ring()), result.rest).bend.mean()))


def complaints(found: dict[str, Result]) -> list[str]:
    """What the paper says and these do not show."""
    without, ground, near = map(bent, found.values())
    wrong = [] if ground > without else ["the ground does not make the natural shape less flat"]
    return wrong + ([] if near < 0.05 * ground else ["prefer= does not make it flat"])


if __name__ == "__main__":
    out, (scene, found) = folder(__doc__), measure()
    x, touch = scene.target.vertices, scene.problem.contacts
    red = x[touch.vertices[touch.obstacle == 1]]
    first = f"target: {len(red)} vertices touch the ground"
    poses = [Pose(first, x, colours=("#9b59b6", "#6c3483"), dots=red)]
    poses += [
        Pose(f"natural shape, {k}: {bent(r):.1f} degrees", r.rest, colours=ORANGE)
        for k, r in found.items()
    ]
    pictures = panels(scene, poses, view=(28.0, 16.0))
    write_sheet([pictures[:2], pictures[2:]], out / "fig13_ground.png", shrink=0.6)
    conclude([f"{name}: bent by {bent(one):.3g} degrees" for name, one in found.items()], [])
    conclude([], complaints(found))
