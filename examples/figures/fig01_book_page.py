"""Ly 2018, Fig. 1: an arched book page, simulated without and with inversion, and in the wind.

The page is the Book Page enlarged 1.5 times, which is nearly as large as its material of Table 1 can hold.
Checked: with the target as natural shape the arch falls and its free edge slides over the book; with ours
the page does not move, to rounding.  A wind that is too weak to flip the page of the paper's size makes it
slide, and stick again as an arch; a strong one flips it onto the other half of the book.
"""

from dataclasses import replace

import numpy as np
from stage import Pose, conclude, folder, panels

from casashell import Simulation, simulate, solve
from casashell.app.paper_scenes import book_page
from casashell.app.resimulation_scenes import examples, measured
from casashell.app.scene import Scene
from casashell.io.sheet import write_sheet

ENLARGED, SECONDS, FREE = 1.5, 2.0, slice(-43, None)  # the last row is the free edge


def measure() -> tuple[Scene, Simulation, Simulation]:
    """The large page, and how it moves with the target and with ours as natural shape."""
    paper = book_page()
    scene = replace(paper, target=paper.target.moved(ENLARGED * paper.target.vertices))
    result = solve(scene.problem).require()
    return scene, simulate(result, SECONDS, rest="target"), simulate(result, SECONDS)


def complaints(naive: Simulation, ours: Simulation) -> list[str]:
    """What the paper says and these do not show."""
    slid = np.ptp(naive.positions[[0, -1], FREE].mean(axis=1)[:, 0]) / naive.size
    wrong = [f"without inversion the edge slides {slid:.2g} only"] if slid < 0.1 else []
    wrong += [f"ours drifts {ours.drift.max():.1e}"] if ours.drift.max() > 1e-12 else []
    return wrong + (
        [f"ours moves at {ours.speeds.max():.1e} m/s"] if ours.speeds[-1] > 1e-9 else []
    )


if __name__ == "__main__":
    out, (scene, naive, ours) = folder(__doc__), measure()
    (example,) = (one for one in examples()[0] if one.title == "Book Page")
    result = solve(example.make().problem).require()
    played = {act: act.play(result) for act in example.acts}
    numbers = {act: measured(act, result, run) for act, run in played.items()}
    lines = [f"without inversion: drift {naive.drift.max():.2g} in {SECONDS:g} s"]
    lines += [f"ours: drift {ours.drift.max():.1e}, {ours.speeds[-1]:.1e} m/s at the end"]
    lines += [f"{act.name}: {found}" for act, found in numbers.items()]
    first = [
        Pose("target", scene.target.vertices),
        Pose(f"natural shape = target, after {SECONDS:g} s", naive.positions[-1]),
        Pose(f"our natural shape, after {SECONDS:g} s: {ours.drift[-1]:.0e}", ours.positions[-1]),
    ]
    weak, strong = played.values()
    second = [
        Pose("weak wind: slid, and sticks again", weak.positions[-1]),
        Pose("strong wind: on its way", strong.positions[int(0.4 * len(strong.times))]),
        Pose("strong wind: on the other half", strong.positions[-1]),
    ]
    first, second = panels(scene, first, height=440), panels(example.make(), second, height=440)
    for name, row in {"fig01_book_page": first, "fig01_book_page_wind": second}.items():
        write_sheet([row], out / f"{name}.png", shrink=0.8)
    wrong = [text for act, found in numbers.items() for text in act.complaints(found)]
    conclude(lines, complaints(naive, ours) + wrong)
