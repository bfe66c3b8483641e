"""Off-screen rendering with pyvista: layers in, pixels out.  The only door to VTK."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Final

import numpy as np

from casashell.io.camera import Camera
from casashell.io.tessellate import Surface
from casashell.mesh import TriMesh
from casashell.typing import AnyArray, FloatArray

INSTALL: Final = "pip install 'pyvista>=0.44' matplotlib"
# Below this many pixels between mesh edges they would only grey the picture.
_LEGIBLE: Final = 5.0
# How far a layer behind is pushed away from the eye, as a share of the picture's height.
_RECESS: Final = 0.006
_EGL: Final = "vtkEGLRenderWindow"
BACKGROUND: Final = "#f5f6f8"
# Towards the light in camera axes (right, up, to the eye), and its strength: key, fill, head.
_LIGHTS: Final = (((-0.5, 0.8, 0.8), 0.55), ((0.9, 0.1, 0.6), 0.18), ((0.0, 0.0, 1.0), 0.42))


class PicturesUnavailable(ImportError):
    """The packages that draw pictures are not installed; the message says how to get them."""


@dataclass(frozen=True, eq=False)
class Layer:
    """One thing in a picture.

    surface   what to draw; a TriMesh is drawn with its polygons
    colour    one colour, or an array (V,3) uint8 with one per vertex
    inside    colour of the back faces, the same as in front when empty
    edges     draw the mesh edges where they are legible
    behind    give way where another layer touches this one, or cuts a little into it as flat
              faces between contacts on a round obstacle do
    bright    more colour and less shade, for small things
    creases   shade each face by itself where normals jump: a one-sided band has such a seam
    """

    surface: Surface | TriMesh
    colour: str | AnyArray
    inside: str = ""
    opacity: float = 1.0
    edges: bool = False
    behind: bool = False
    bright: bool = False
    creases: bool = False


@dataclass(frozen=True, eq=False)
class Dots:
    """Round points (n,3) of a width in pixels."""

    points: FloatArray
    colour: str
    width: float = 9.0


@dataclass(frozen=True, eq=False)
class Curves:
    """Polylines, each (n,3), of a width in pixels."""

    lines: tuple[FloatArray, ...]
    colour: str
    width: float = 3.0


@dataclass(eq=False)
class Studio:
    """A render window that is opened once and closed with the ``with`` block.

    PicturesUnavailable: pyvista is not installed.
    """

    _plotter: Any = field(default=None, init=False)

    def __enter__(self) -> Studio:
        pv = _pyvista()
        with _headless():
            self._plotter = pv.Plotter(off_screen=True, window_size=(64, 64), lighting="none")
            self._plotter.set_background(BACKGROUND)
            for place, strength in _LIGHTS:
                light = pv.Light(light_type="camera light", intensity=strength)
                light.position = place
                self._plotter.add_light(light)
            self._plotter.enable_anti_aliasing("ssaa")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._plotter.close()
        self._plotter.deep_clean()

    def shoot(
        self, layers: Sequence[Layer | Dots | Curves], camera: Camera, size: tuple[int, int]
    ) -> AnyArray:
        """Picture (height, width, 3) uint8 of the layers; size is (width, height) in pixels."""
        plotter = self._plotter
        plotter.clear_actors()
        per_pixel = camera.size / size[1]
        for layer in layers:
            if isinstance(layer, Dots):
                self._dots(layer)
            elif isinstance(layer, Curves):
                self._curves(layer)
            elif len(layer.surface.faces):
                self._surface(layer, camera, per_pixel)
        plotter.camera.view_angle = camera.view_angle
        plotter.camera_position = [
            tuple(camera.position),
            tuple(camera.focus),
            tuple(camera.up),
        ]
        plotter.renderer.ResetCameraClippingRange()
        plotter.window_size = size
        with _headless():
            picture = plotter.screenshot(None, return_img=True)
        return np.ascontiguousarray(picture[:, :, :3])

    def _surface(self, layer: Layer, camera: Camera, per_pixel: float) -> None:
        surface = _polydata(layer.surface)
        edge = float(np.sqrt(4.0 * surface.area / np.sqrt(3.0) / max(surface.n_cells, 1)))
        plain = isinstance(layer.colour, str)
        ambient = 0.6 if layer.bright else 0.2 if plain else 0.42
        if not plain:
            surface.point_data["rgb"] = layer.colour
        inside = {"color": layer.inside, "ambient": ambient + 0.15, "diffuse": 1.05 - ambient}
        actor = self._plotter.add_mesh(
            surface,
            color=layer.colour if plain else None,
            scalars=None if plain else "rgb",
            rgb=not plain,
            opacity=layer.opacity,
            smooth_shading=True,
            split_sharp_edges=layer.behind or layer.creases,
            feature_angle=40.0,
            show_edges=layer.edges and edge > _LEGIBLE * per_pixel,
            edge_color="#20262d",
            edge_opacity=0.22,
            line_width=1.0,
            ambient=ambient,
            diffuse=1.05 - ambient,
            specular=0.04,
            backface_params=inside if layer.inside and plain else None,
            show_scalar_bar=False,
            reset_camera=False,
            render=False,
        )
        if layer.behind:
            # Along the line of sight: hardly seen, except that what it touches comes out on top.
            away = camera.focus - camera.position
            actor.position = _RECESS * camera.size * away / np.linalg.norm(away)

    def _dots(self, dots: Dots) -> None:
        if len(dots.points):
            self._plotter.add_points(
                dots.points,
                color=dots.colour,
                point_size=dots.width,
                render_points_as_spheres=True,
                reset_camera=False,
                render=False,
            )

    def _curves(self, curves: Curves) -> None:
        """All lines as one object: hundreds of them would take hundreds of draw calls."""
        if not curves.lines:
            return
        counts = [len(points) for points in curves.lines]
        starts = np.cumsum([0, *counts[:-1]])
        cells = [np.r_[count, start : start + count] for count, start in zip(counts, starts)]
        lines = _pyvista().PolyData(np.concatenate(curves.lines), lines=np.concatenate(cells))
        self._plotter.add_mesh(
            lines,
            color=curves.colour,
            line_width=curves.width,
            lighting=False,
            show_scalar_bar=False,
            reset_camera=False,
            render=False,
        )


def _pyvista() -> Any:
    """The pyvista module; PicturesUnavailable without it."""
    try:
        import pyvista
    except ImportError as error:
        raise PicturesUnavailable(f"pictures need pyvista ({error}): {INSTALL}") from error
    return pyvista


def _polydata(surface: Surface | TriMesh) -> Any:
    """The surface for VTK, polygons unsplit so that their diagonals are not drawn."""
    pv = _pyvista()
    if isinstance(surface, TriMesh) and surface.polygons:
        flat = [np.array([len(polygon), *polygon]) for polygon in surface.polygons]
        return pv.PolyData(np.array(surface.vertices), faces=np.concatenate(flat))
    return pv.PolyData.from_regular_faces(np.array(surface.vertices), np.array(surface.faces))


@contextmanager
def _headless() -> Iterator[None]:
    """Without a display let VTK open an EGL window at once instead of trying (and blaming) X."""
    name = "VTK_DEFAULT_OPENGL_WINDOW"
    wanted = sys.platform.startswith("linux") and not os.environ.get("DISPLAY")
    ours = wanted and name not in os.environ
    if ours:
        os.environ[name] = _EGL
    try:
        with warnings.catch_warnings():
            # pyvista on what this graphics driver cannot do; the picture is made all the same.
            warnings.filterwarnings("ignore", message=".*anti-aliasing.*")
            yield
    finally:
        if ours:
            del os.environ[name]
