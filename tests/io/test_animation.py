"""What an animation refuses, what it knows, and the camera that sees all of it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from moving import moving, strip

from casashell.io.animation import Animation, Track
from casashell.io.animation_camera import framing, outermost


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": " "}, "needs a name"),
        ({"positions": np.zeros((3, 4))}, r"'a/b': positions must have shape \(F, V, 3\)"),
        ({"positions": np.zeros((0, 16, 3))}, "empty"),
        ({"faces": np.array([[0, 1, 99]])}, "'a/b': .*99"),
        ({"rest": np.zeros((3, 3))}, r"'a/b': rest must have shape \(16, 3\)"),
        ({"rest": np.full((16, 3), np.inf)}, "rest not finite at vertex 0"),
        ({"rest_angles": np.zeros(2)}, r"rest_angles must have shape \(13,\)"),
        ({"lines": np.zeros((6, 2, 3))}, r"lines must have shape \(6, L, 2, 3\)"),
        ({"contact": np.zeros((6, 16))}, "true or false"),
        ({"contact": np.zeros((5, 16), dtype=bool)}, r"contact must have shape \(6, 16\)"),
    ],
)
def test_a_track_names_what_is_wrong(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(moving().tracks[0], **change)


def test_a_vertex_that_is_not_finite_is_named_with_its_frame() -> None:
    positions = np.array(moving().tracks[0].positions)
    positions[3, 5, 1] = np.nan
    with pytest.raises(ValueError, match="'a/b': positions not finite at frame 3, vertex 5"):
        replace(moving().tracks[0], positions=positions)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": np.zeros(0)}, "at least one frame"),
        ({"times": np.array([0.0, 1, 2, 2, 3, 4])}, "frame 3 is at 2.0 s"),
        ({"times": np.array([0.0, 1, 2, np.nan, 3, 4])}, "frame 3 is at nan s"),
        ({"times": np.arange(5.0)}, "'a/b' has 6 frames, times has 5"),
        ({"tracks": ()}, "at least one track"),
        ({"tracks": moving().tracks[:1] * 2}, "two tracks are named 'a/b'"),
        ({"up": (0.0, 0.0, 0.0)}, "up"),
        ({"captions": ("one",)}, "got 1 for 6 frames"),
        ({"series": {"e": np.zeros(4)}}, r"series 'e' must have shape \(6,\), got \(4,\)"),
    ],
)
def test_an_animation_names_what_is_wrong(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(moving(), **change)


def test_the_rate_is_that_of_most_frames() -> None:
    assert moving().fps == 30.0
    assert moving().even
    uneven = replace(moving(), times=np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.7]))
    assert uneven.fps == 10.0
    assert not uneven.even


def test_a_still_track_takes_the_memory_of_one_frame() -> None:
    floor = moving(frames=500).tracks[2]
    assert not floor.moves
    assert floor.positions.shape[0] == 500
    assert floor.positions.strides[0] == 0


def test_a_moebius_band_has_no_front() -> None:
    columns = 12
    band, faces = strip(columns)
    twisted = np.where(faces % columns == columns - 1, (faces + 1) % (2 * columns), faces)
    assert moving().tracks[0].orientable
    assert not Track("m", band[None], twisted).orientable


def test_the_extreme_points_are_those_of_all_frames() -> None:
    random = np.random.default_rng(3)
    cloud = random.normal(size=(40, 50, 3))
    few = outermost(cloud)
    assert len(few) < 200
    every = cloud.reshape(-1, 3)
    assert np.array_equal(few.min(axis=0), every.min(axis=0))  # the axes are among the directions
    assert np.array_equal(few.max(axis=0), every.max(axis=0))
    # In other directions the reach is short by the gap between directions at most: 128 of them
    # leave caps of about 0.18 rad.
    for direction in random.normal(size=(20, 3)):
        direction /= np.linalg.norm(direction)
        assert (few @ direction).max() > (every @ direction).max() * math.cos(0.25)


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_no_frame_leaves_the_picture(up: str) -> None:
    animation: Animation = moving(frames=20, up=up)
    camera = framing(animation)
    toward = camera.position - camera.focus
    distance = float(np.linalg.norm(toward))
    toward = toward / distance
    across = np.cross(camera.up, toward)
    across /= np.linalg.norm(across)
    points = animation.tracks[0].positions.reshape(-1, 3) - camera.position
    depth = -points @ toward
    slope = math.tan(0.5 * math.radians(camera.view_angle))
    assert np.all(np.abs(points @ across) < slope * camera.aspect * depth)
    assert np.all(np.abs(points @ np.cross(toward, across)) < slope * depth)
