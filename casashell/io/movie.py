"""An animation as a film, MP4 or GIF, drawn without a display in the looks of the pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from casashell.io.animation import Animation, Track
from casashell.io.animation_camera import framing
from casashell.io.animation_files import Progress
from casashell.io.camera import Camera
from casashell.io.colours import CONTACT, OBSTACLE, SHELL, SHELL_INSIDE
from casashell.io.movie_files import INSTALL, Gif, MovieUnavailable, Mp4
from casashell.io.staging import staged_file
from casashell.io.studio import Curves, Dots, Layer, Studio
from casashell.io.tessellate import Surface
from casashell.typing import AnyArray, FloatArray

_SUFFIXES: Final = (".mp4", ".gif")
_INK: Final = "#23272e"
_SOFT: Final = "#5d6672"
_LINE: Final = "#1f3f66"
# GIF counts in hundredths of a second, and players slow down what is shorter than two.
_GIF_FPS: Final = 25.0
# Lines are drawn this share of the picture's height nearer to the eye, out of their own surface.
_LIFT: Final = 0.004


def write_movie(
    animation: Animation,
    path: Path,
    *,
    fps: float | None = None,
    speed: float = 1.0,
    height: int = 720,
    contacts: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Path:
    """Write ``.mp4`` (H.264) or ``.gif``; return the path.

    fps       pictures a second; by default the rate of the animation, 25 at most for GIF
    speed     seconds of the animation in one second of the film
    height    pixels; the width follows from the motion, 0.6 to 2 times as much
    contacts  mark the vertices in contact
    progress  called after every picture; what it raises ends the work

    Each picture is the frame nearest in time.  The camera is fixed and sees the whole motion.  An
    interrupted run leaves nothing behind.

    MovieUnavailable, PicturesUnavailable (ImportErrors): a package is missing; raised before any
    work.  FileExistsError: the file is there and ``overwrite`` is False.  ValueError: another
    extension, or a rate, speed or size that is not positive.
    """
    file = Path(path)
    if file.suffix.lower() not in _SUFFIXES:
        raise ValueError(f"{file}: a film ends in {' or '.join(_SUFFIXES)}")
    gif = file.suffix.lower() == ".gif"
    rate = fps if fps is not None else min(animation.fps, _GIF_FPS if gif else 120.0)
    for what, value in (("fps", rate), ("speed", speed)):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{what} must be positive, got {value}")
    if not 64 <= height <= 4320:
        raise ValueError(f"height must be 64 to 4320 pixels, got {height}")
    shown = picked_frames(animation, rate, speed)
    film_kind = Gif if gif else Mp4
    title = Title(animation, height)
    _check_pyvista()
    with staged_file(file, overwrite=overwrite) as temporary, film_kind(temporary, rate) as film:
        inner = height - title.band
        for count, picture in enumerate(_pictures(animation, shown, inner, contacts)):
            film.add(title.over(picture, int(shown[count])))
            if progress is not None:
                progress(count + 1, len(shown))
    return file


def picked_frames(animation: Animation, fps: float, speed: float = 1.0) -> AnyArray:
    """Frame (n,) nearest in time to each picture of a film with ``fps`` pictures a second.

    The last picture is the last frame, also where it comes sooner than a picture's time.
    """
    times = animation.times - animation.times[0]
    count = math.ceil(times[-1] * fps / speed - 1e-6) + 1
    wanted = np.minimum(np.arange(count) * speed / fps, times[-1])
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1) if len(times) > 1 else 0
    before = np.maximum(np.asarray(after) - 1, 0)
    nearer = wanted - times[before] < times[after] - wanted
    picked: AnyArray = np.where(nearer, before, after) * np.ones(count, dtype=np.int64)
    return picked


def _pictures(
    animation: Animation, shown: AnyArray, height: int, contacts: bool
) -> Iterator[AnyArray]:
    camera = framing(animation)
    size = (2 * round(0.5 * height * camera.aspect), 2 * (height // 2))
    with Studio() as studio:
        for frame in shown.tolist():
            layers: list[Layer | Dots | Curves] = []
            for track in animation.tracks:
                layers += _layers(track, frame, camera, contacts)
            yield studio.shoot(layers, camera, size)


def _layers(
    track: Track, frame: int, camera: Camera, contacts: bool
) -> Iterator[Layer | Dots | Curves]:
    points = track.positions[frame]
    surface = Surface(points, track.faces)
    if track.body:
        yield Layer(surface, OBSTACLE, behind=True)
    else:
        # Rulings need a bright ground; a band without a front has one colour.
        ruled, front = track.lines is not None, track.orientable
        inside = SHELL_INSIDE if front else ""
        yield Layer(surface, SHELL, inside, edges=not ruled, bright=ruled, creases=not front)
    if track.lines is not None and track.lines.shape[1]:
        yield Curves(tuple(_lifted(track.lines[frame], camera)), _LINE, 3.0)
    if contacts and track.contact is not None:
        yield Dots(_lifted(points[track.contact[frame]], camera), CONTACT, 7.0)


def _lifted(points: FloatArray, camera: Camera) -> FloatArray:
    """Points (...,3) a little nearer to the eye, in the same place of the picture."""
    distance = np.linalg.norm(camera.position - camera.focus)
    lifted: FloatArray = points + (_LIFT * camera.size / distance) * (camera.position - points)
    return lifted


def _check_pyvista() -> None:
    try:
        import pyvista  # noqa: F401  (imported by the studio, once the file is open)
    except ImportError as error:
        raise MovieUnavailable(f"films need pyvista ({error}): {INSTALL}") from error


@dataclass(eq=False)
class Title:
    """Title, time and caption in a band above the pictures.  MovieUnavailable without pillow."""

    animation: Animation
    height: int

    @property
    def band(self) -> int:
        """Height of the band in pixels, of ``height`` for band and picture."""
        large, small = self._fonts
        lines = 1.5 * large.size + (1.5 * small.size if self.animation.captions else 0.0)
        return 2 * math.ceil(0.5 * float(self._edge + lines))

    @property
    def _edge(self) -> int:
        return round(0.015 * self.height)

    def __post_init__(self) -> None:
        try:
            from matplotlib.font_manager import findfont
            from PIL import Image, ImageDraw, ImageFont
        except ImportError as error:
            raise MovieUnavailable(
                f"films need pillow and matplotlib ({error}): {INSTALL}"
            ) from error
        self._image, self._draw = Image, ImageDraw
        small = max(round(0.024 * self.height), 9)
        self._fonts = [ImageFont.truetype(findfont("DejaVu Sans"), n) for n in (small + 3, small)]

    def over(self, picture: AnyArray, frame: int) -> AnyArray:
        """The picture with the words of a frame."""
        tall, width = picture.shape[0] + self.band, picture.shape[1]
        image = self._image.new(
            "RGB", (width, tall), tuple(int(part) for part in picture[0, 0, :3])
        )
        image.paste(self._image.fromarray(picture), (0, self.band))
        draw = self._draw.Draw(image)
        edge = self._edge
        large, small = self._fonts
        clock = f"{self.animation.times[frame]:.2f} s"
        draw.text((edge, edge), self.animation.title, _INK, large)
        draw.text((width - edge, edge), clock, _SOFT, small, anchor="ra")
        if self.animation.captions:
            below = edge + round(1.5 * large.size)
            draw.text((edge, below), self.animation.captions[frame], _SOFT, small)
        return np.asarray(image)
