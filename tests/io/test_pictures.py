"""Pictures: sizes, not blank, signs of the colour maps, what happens when things are missing."""

from __future__ import annotations

import builtins
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_result import dome, failed, sample

from casashell.contact.obstacles import Capsule, Cone, Cylinder, Plane
from casashell.io.camera import directions, framed
from casashell.io.colours import bending_map, stretch_map
from casashell.io.forces import force_arrows, friction_use
from casashell.io.labels import engineering, round_up
from casashell.io.pictures import PicturesUnavailable, write_pictures
from casashell.io.tessellate import Region, Surface, cropped, tessellate, thinned
from casashell.typing import AnyArray, FloatArray

NAMES = ("target", "forces", "compare", "natural", "stretch", "bending", "overview")


@pytest.fixture
def drawing() -> None:
    for module in ("pyvista", "matplotlib", "PIL"):
        pytest.importorskip(module, reason=f"{module} is not installed (extra viz)")


def pixels(path: Path) -> AnyArray:
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(float)


def coloured(picture: AnyArray) -> tuple[int, int]:
    """Number of clearly blue and of clearly red pixels above the colour bar."""
    view = picture[: int(0.8 * len(picture))]
    red, blue = view[..., 0], view[..., 2]
    return int(np.sum(blue - red > 40)), int(np.sum(red - blue > 40))


@pytest.mark.usefixtures("drawing")
def test_pictures_are_written_and_not_blank(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    paths = write_pictures(sample(), tmp_path / "new")
    assert [path.name for path in paths] == [f"{name}.png" for name in NAMES]
    for path in paths:
        picture = pixels(path)
        height, width, _ = picture.shape
        assert 400 < width < 4000
        assert 400 < height < 4000
        # Something in the middle differs from the light background.
        middle = picture[height // 8 : height // 2, width // 8 : -width // 8]
        assert np.ptp(middle) > 60, path.name
    # Two rows of three panels.
    assert pixels(paths[-1]).shape[1] > 1.5 * pixels(paths[0]).shape[1]
    assert capfd.readouterr().err == ""


@pytest.mark.usefixtures("drawing")
def test_shrunk_is_blue_and_dilated_is_red(tmp_path: Path) -> None:
    # Fig. 10 of Ly et al. 2018: blue where the natural shape is compressed, red where dilated.
    blue, red = coloured(pixels(write_pictures(sample(0.9), tmp_path / "a")[4]))
    assert blue > 20_000
    assert red == 0
    blue, red = coloured(pixels(write_pictures(sample(1.1), tmp_path / "b")[4]))
    assert red > 20_000
    assert blue == 0


@pytest.mark.usefixtures("drawing")
def test_result_without_contacts_obstacles_and_change(tmp_path: Path) -> None:
    # Nothing is stretched: both maps stay white.
    paths = write_pictures(failed(), tmp_path, up=(0.0, 0.0, 1.0))
    assert coloured(pixels(paths[4])) == (0, 0)
    assert coloured(pixels(paths[5])) == (0, 0)


def test_missing_package_is_one_clear_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.split(".")[0] == "pyvista":
            raise ImportError("No module named 'pyvista'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(PicturesUnavailable, match=r"pip install 'pyvista") as caught:
        write_pictures(sample(), tmp_path / "none")
    assert isinstance(caught.value, ImportError)
    assert not (tmp_path / "none").exists()


def test_natural_shape_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    rest = np.array(sample().rest)
    rest[7, 1] = np.nan
    with pytest.raises(ValueError, match="vertex 7"):
        write_pictures(replace(sample(), rest=rest), tmp_path)


def test_colour_maps_have_the_signs_of_the_paper() -> None:
    stretch = stretch_map(np.array([-0.1, 0.1]))
    compressed, same, dilated = stretch.rgb(np.array([-0.1, 0.0, 0.1])).astype(int)
    assert compressed[2] > compressed[0] + 40
    assert list(same) == [255, 255, 255]
    assert dilated[0] > dilated[2] + 40
    assert stretch.low == -stretch.high
    flat, folded = bending_map(np.array([0.0, 0.5])).rgb(np.array([0.0, 0.5])).astype(int)
    assert list(flat) == [255, 255, 255]
    assert folded[0] > folded[2] + 40


def test_one_outlier_does_not_set_the_range() -> None:
    values = np.full(1000, 0.01)
    values[3] = 5.0
    chosen = stretch_map(values)
    assert chosen.high == pytest.approx(0.01)
    assert chosen.clipped


def test_friction_in_use() -> None:
    # Closed form |f_T| / (mu f_N): 0.25 / 0.5, 0.5 / 0.25; a pulling force is beyond any cone.
    arrows = force_arrows(sample())
    np.testing.assert_allclose(arrows.use, [0.5, 2.0])
    assert arrows.longest == pytest.approx(np.hypot(1.0, 0.25))
    pulling = friction_use(np.array([[0.0, -1.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]), np.ones(1))
    assert np.isinf(pulling[0])
    slick = friction_use(np.array([[0.0, 1.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]), np.zeros(1))
    assert slick[0] == 0.0


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1), (1, 0, 0), (0, -1, 0), (1, 2, 3)])
def test_camera_sees_every_point(up: tuple[float, float, float]) -> None:
    points = dome().vertices * [3.0, 1.0, 1.0]
    camera = framed(points, up=up)
    toward = camera.position - camera.focus
    depth = np.linalg.norm(toward)
    toward = toward / depth
    across = np.cross(camera.up, toward)
    across /= np.linalg.norm(across)
    slope = np.tan(np.radians(camera.view_angle) / 2)
    arm = points - camera.position
    reach = -(arm @ toward) * slope
    assert np.all(np.abs(arm @ np.cross(toward, across)) <= reach)
    assert np.all(np.abs(arm @ across) <= reach * camera.aspect)


@pytest.mark.parametrize("up", [(0, 0, 0), (0, np.nan, 1), (0, 1)])
def test_up_without_direction_is_refused(up: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="up must be"):
        directions(up)


@pytest.mark.parametrize("size", [1e-300, 1e300])
def test_up_may_be_as_long_as_it_likes(size: float) -> None:
    for found, wanted in zip(directions((0.0, size, 0.0)), directions((0.0, 1.0, 0.0))):
        np.testing.assert_array_equal(found, wanted)


class Egg:
    """An obstacle of a kind this package does not know: a ball of 0.3 m."""

    friction = 0.5
    name = "egg"

    def signed_distance(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        length = np.linalg.norm(points, axis=1)
        return length - 0.3, points / np.maximum(length, 1e-12)[:, None]

    def bounding_box(self) -> None:
        return None


OBSTACLES = [
    Plane((1.0, 2.0, 0.5), 0.1),
    sample().obstacles[0],
    Cylinder((0.1, 0.0, 0.0), (0.0, 1.0, 1.0), 0.2),
    Cylinder((0.1, 0.0, 0.0), (0.0, 1.0, 1.0), 0.2, 0.7),
    Cone((0.0, 0.4, 0.0), (0.0, -1.0, 0.1), 0.5),
    Cone((0.0, 0.4, 0.0), (0.0, -1.0, 0.1), 0.5, 0.8),
    Capsule((0.0, 0.0, 0.0), (0.3, 0.2, 0.1), 0.15),
    Capsule((0.0, 0.1, 0.0), (0.0, 0.1, 0.0), 0.15),
    Egg(),
]


@pytest.mark.parametrize("obstacle", OBSTACLES, ids=lambda o: type(o).__name__)
def test_tessellation_lies_on_the_obstacle_and_faces_outward(obstacle: Any) -> None:
    surface = tessellate(obstacle, Region(np.zeros(3), 1.0))
    # Only an unknown kind is sampled on a grid, with cells of 2 m / 55.
    tolerance = 2e-3 if isinstance(obstacle, Egg) else 1e-12
    distance, _ = obstacle.signed_distance(surface.vertices)
    np.testing.assert_allclose(distance, 0.0, atol=tolerance)
    a, b, c = (surface.vertices[surface.faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    assert size.max() > 0
    centre = (a + b + c) / 3
    _, outward = obstacle.signed_distance(centre)
    big = size > 1e-3 * size.max()
    assert np.mean(np.einsum("ij,ij->i", normal, outward)[big] > 0) > 0.99


def test_thinning_keeps_positions_and_identity() -> None:
    mesh = dome(60)
    thin, ids = thinned(Surface(mesh.vertices, mesh.faces), 1000)
    assert 300 < len(thin.faces) <= 1000
    np.testing.assert_array_equal(thin.vertices, mesh.vertices[ids])
    assert len(np.unique(ids)) == len(ids)


def test_cropping_keeps_what_is_near() -> None:
    mesh = dome(20)
    part = cropped(Surface(mesh.vertices, mesh.faces), Region(mesh.vertices[0], 0.2))
    assert 0 < len(part.faces) < len(mesh.faces)
    assert np.linalg.norm(part.vertices - mesh.vertices[0], axis=1).min() == 0.0


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.01234, "N", "12.3 mN"),
        (999.96, "N", "1.00 kN"),
        (-2.5e-7, "m", "−250 nm"),
        (0.0, "N", "0 N"),
        (1234.5, "", "1230"),
        (3.25e-12, "", "3.25e−12"),
        (-2.5e299, "N", "−2.50e+299 N"),
    ],
)
def test_engineering_form(value: float, unit: str, text: str) -> None:
    assert engineering(value, unit) == text


def test_round_limits() -> None:
    assert [round_up(v) for v in (0.0, 0.011, 0.9, 42.0)] == [0.0, 0.015, 1.0, 50.0]
