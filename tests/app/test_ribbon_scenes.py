"""Scene files of ribbons and the built-in scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from casashell.app.ribbon_chains import LINKS
from casashell.app.ribbon_reader import read_ribbon_scene
from casashell.app.ribbon_run import RibbonOptions, read_setup
from casashell.app.ribbon_scenes import SCENES, builtin_setup
from casashell.app.ribbon_setup import Course
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.dynamics import simulate
from casashell.typing import FloatArray

EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "ribbons").glob("*.toml"))
STRIP = "[[ribbon]]\nlength = 1.0\nwidth = 0.1\nsegments = 10\n"


def read(tmp_path: Path, text: str) -> object:
    """The scene with this text, checked as the command does."""
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return read_setup(RibbonOptions(str(path)))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seconds = 1.0", "ribbon is missing"),
        ("colour = 1\n" + STRIP, "unknown key 'colour'"),
        (STRIP + "lenght = 1", "ribbon 0: unknown key 'lenght'; did you mean 'length'"),
        (STRIP.replace("10", "1"), "segments must be a whole number >= 2"),
        (STRIP.replace("10", "2.5"), "segments must be a whole number"),
        (STRIP.replace("0.1", "0.6") + 'ends = "moebius"', "length / width > sqrt(3)"),
        (STRIP + "target_rulings = 9.0", "rulings 0 and 1 cross"),
        (STRIP + "density = -1", "ribbon 0: density must be"),
        (STRIP + '[ribbon.start]\nshape = "spiral"', "[ribbon.start]: shape must be one of"),
        (STRIP + '[ribbon.start]\nshape = "helix"', "[ribbon.start]: radius is missing"),
        (STRIP + '[ribbon.start]\nshape = "circle"', "no start for ends"),
        (STRIP + "[ribbon.start]\nalong = [0,1,0]", "across must be a direction"),
        (STRIP + "[ribbon.start]\nspin = [0,1,0]", "starts at rest"),
        (STRIP + "[[ribbon.attachment]]\ns = 2.0", "attachment 0: material point (2, 0) lies"),
        (STRIP + "[[ribbon.attachment]]\ns = 1.0\nplace = [2.0,0,0]", "contradict each other"),
        (
            STRIP + "[[ribbon.attachment]]\ns = 1.0\ntimes = [0,1]\nplaces = [[1.0,0,0],[2.0,0,0]]",
            "ribbon 0 at t = 0.01 s: the clamped begin and attachment 0 contradict",
        ),
        (
            STRIP + "[[ribbon.attachment]]\ns = 1.0\ntimes = [0,0]\nmoves = [[0,0,0],[0,0,1]]",
            "increase",
        ),
        (STRIP + "[[ribbon.load]]\ns = 1.0", "load 0: force is missing"),
        (STRIP + "[[ribbon.guide]]\nsegments = [10]", "guide 0: segments must be some of 0 .. 9"),
        (STRIP + "[[ribbon.guide]]\nsegments = [9]\nturns = [0, 1]", "guide 0: axis is missing"),
        (STRIP + '[ribbon.begin]\nmotion = "none.toml"', "none.toml"),
        (STRIP + STRIP + 'name = "ribbon 0"', "name 'ribbon 0' is taken"),
        (STRIP + '[[obstacle]]\nkind = "plane"\nnormal = [0,0,1]\noffset = -1', "need a thickness"),
        (STRIP + '[[obstacle]]\nkind = "box"', "obstacle 1: no obstacle of kind 'box'"),
        ("thickness = -1.0\n" + STRIP, "thickness must be"),
    ],
)
def test_what_is_wrong_is_named(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises((ValueError, OSError)) as caught:
        read(tmp_path, text)
    message = str(caught.value)
    assert words in message
    assert message.startswith(str(tmp_path)) or "ribbon 0 at t" in message or "No such" in message


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_scenes_make_their_first_steps(path: Path) -> None:
    setup = read_ribbon_scene(path)
    setup.require_possible()
    made = simulate(setup.scene, 2 * setup.step, setup.step, workers=1)
    assert made.status == "COMPLETE", made.message


@pytest.mark.parametrize("name", ["cantilever", "helix", "torsion", "dragging", "double-chain"])
def test_built_in_scenes_make_their_first_steps(name: str) -> None:
    setup = builtin_setup(name)
    setup.require_possible()
    made = simulate(setup.scene, setup.step, setup.step)
    assert made.status == "COMPLETE", made.message
    assert made.violation.max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SCENES))
def test_built_in_scenes_run(name: str) -> None:
    setup = builtin_setup(name)
    made = simulate(setup.scene, 0.5 * setup.seconds, setup.step)
    assert made.status == "COMPLETE", made.message


def linked(one: FloatArray, two: FloatArray) -> float:
    """Gauss linking integral of closed polygons, subdivided."""
    fine = []
    for points in (one, two):
        share = np.arange(8)[:, None, None] / 8
        ahead = np.roll(points, -1, axis=0)
        fine.append(((1 - share) * points + share * ahead).transpose(1, 0, 2).reshape(-1, 3))
    along = [np.roll(points, -1, axis=0) - points for points in fine]
    middle = [points + 0.5 * step for points, step in zip(fine, along)]
    apart = middle[0][:, None] - middle[1][None]
    both = np.cross(along[0][:, None], along[1][None])
    part = np.einsum("ijk,ijk->ij", apart, both) / np.linalg.norm(apart, axis=2) ** 3
    return float(part.sum() / (4 * np.pi))


@pytest.mark.parametrize(("name", "chains"), [("double-chain", 2), ("moebius-chain", 1)])
def test_chains_are_linked_and_do_not_touch(name: str, chains: int) -> None:
    """Neighbours once (Gauss), others not at all."""
    scene = builtin_setup(name).scene
    shapes = [reconstruct(body.ribbon, body.initial) for body in scene.bodies]
    rings = [shape.middle[:-1] for shape in shapes]
    assert len(rings) == chains * LINKS
    for k in range(LINKS - 1):
        assert abs(abs(linked(rings[k], rings[k + 1])) - 1) < 0.05
    assert abs(linked(rings[0], rings[2])) < 0.05
    collide = scene.response()
    assert collide is not None
    points = [np.stack([shape.bottom, shape.top]) for shape in shapes]
    kept = collide(points, points)  # refuses what interpenetrates
    assert max(float(np.abs(a - b).max()) for a, b in zip(kept, points)) < 1e-9


def test_courses_rest_outside_of_their_keyframes() -> None:
    course = Course([1.0, 2.0], [[0.0, 0.0], [1.0, 2.0]])
    assert np.array_equal(course.at(0.0), [0.0, 0.0])
    assert np.allclose(course.at(1.5), [0.5, 1.0])
    assert np.array_equal(course.at(9.0), [1.0, 2.0])


def test_twice_as_fast_a_twist_needs_shorter_steps() -> None:
    setup = builtin_setup("torsion").with_times(None, 1.0)
    with pytest.raises(ValueError, match="guide 0 turns by 90 degrees in one step"):
        setup.require_possible()
