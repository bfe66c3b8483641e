"""Ly 2018, Fig. 1: an arched book page, simulated without and with inversion, and in the wind.

The page is the Book Page enlarged 1.5 times, which is nearly as large as its material of Table 1 can hold.
Checked: with the target as natural shape the arch falls and its free edge slides over the book; with ours
the page does not move, to rounding.  A wind that is too weak to flip the page of the paper's size makes it
slide, and stick again as an arch; a strong one flips it onto the other half of the book (``--wind``).
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from stage import Pose, conclude, panels

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


def windy(out: Path) -> tuple[list[str], list[str]]:
    """The acts of Book Page: numbers, complaints, and a picture."""
    (example,) = (one for one in examples()[0] if one.title == "Book Page")
    result = solve(example.make().problem).require()
    weak, strong = (act.play(result) for act in example.acts)
    found = [measured(*pair) for pair in zip(example.acts, (result, result), (weak, strong))]
    poses = [
        Pose("weak wind: slid, and sticks again", weak.positions[-1]),
        Pose("strong wind: on its way", strong.positions[int(0.4 * len(strong.times))]),
        Pose("strong wind: on the other half", strong.positions[-1]),
    ]
    write_sheet([panels(example.make(), poses, height=440)], out / "fig01_wind.png", shrink=0.8)
    wrong = [text for act, one in zip(example.acts, found) for text in act.complaints(one)]
    return [f"{act.name}: {one}" for act, one in zip(example.acts, found)], wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("."))
    parser.add_argument("--wind", action="store_true", help="also in the wind, which takes minutes")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    scene, naive, ours = measure()
    poses = [
        Pose("target", scene.target.vertices),
        Pose(f"natural shape = target, after {SECONDS:g} s", naive.positions[-1]),
        Pose(f"our natural shape, after {SECONDS:g} s", ours.positions[-1]),
    ]
    write_sheet([panels(scene, poses, height=440)], given.out / "fig01_book_page.png", shrink=0.8)
    lines = [f"without inversion: drift {naive.drift.max():.2g} in {SECONDS:g} s"]
    lines += [f"ours: drift {ours.drift.max():.1e}, {ours.speeds[-1]:.1e} m/s at the end"]
    more, wrong = windy(given.out) if given.wind else ([], [])
    conclude([*lines, *more], complaints(naive, ours) + wrong)
