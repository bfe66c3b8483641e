"""Ly 2018, Fig. 2: a floppy hat without inversion, with it, and on a head that shakes.

Checked: without inversion the brim sags; with ours the hat does not move, to rounding; on a head that turns
slowly it stays where it sits, though its brim swings.
"""

import numpy as np
from stage import Pose, conclude, folder, panels

from casashell import Simulation, simulate, solve
from casashell.app.resimulation_scenes import Act, examples, measured
from casashell.app.scene import Scene
from casashell.io.sheet import write_sheet

SECONDS = 0.5


def measure() -> tuple[Scene, Act, dict[str, Simulation], dict[str, float]]:
    """The hat, the slow turn, all simulations, and the numbers of the turn."""
    (example,) = (one for one in examples()[0] if one.title == "Floppy Hat")
    scene, slow = example.make(), example.acts[0]
    result = solve(scene.problem).require()
    runs = {
        "without inversion": simulate(result, SECONDS, rest="target"),
        "ours": simulate(result, SECONDS),
        "turning": slow.play(result),
    }
    return scene, slow, runs, measured(slow, result, runs["turning"])


def complaints(runs: dict[str, Simulation]) -> list[str]:
    """What the paper says and these do not show."""
    naive, ours, _ = runs.values()
    sunk = (naive.positions[0] - naive.positions[-1])[:, 1].max() / naive.size
    wrong = [] if sunk > 0.01 else [f"without inversion the brim sinks by {sunk:.1e} only"]
    return wrong + ([] if ours.drift.max() < 1e-12 else [f"ours drifts {ours.drift.max():.1e}"])


if __name__ == "__main__":
    out, (scene, slow, runs, numbers) = folder(__doc__), measure()
    naive, ours, turning = runs.values()
    side = int(np.argmax(turning.drift))
    still = scene.target.vertices
    poses = [
        Pose("target, and ours after 0.5 s", ours.positions[-1]),
        Pose("natural shape = target, after 0.5 s", naive.positions[-1], outline=still),
        Pose(f"head turning, at {turning.times[side]:.2f} s", turning.positions[side], side / 60),
    ]
    pictures = panels(scene, poses, motion=slow.motion, view=(28.0, 4.0), height=440)
    write_sheet([pictures], out / "fig02_floppy_hat.png", shrink=0.7)
    lines = [f"{name}: drift {run.drift.max():.1e}" for name, run in runs.items()]
    conclude([*lines, str(numbers)], complaints(runs) + slow.complaints(numbers))
