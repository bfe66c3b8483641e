"""An animation as a film, MP4 or GIF, drawn without a display in the looks of the pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Protocol

import numpy as np

from casashell.io.animation import Animation, Track
from casashell.io.animation_camera import framing
from casashell.io.animation_files import Progress
from casashell.io.camera import Camera
from casashell.io.colours import CONTACT, OBSTACLE, SHELL, SHELL_INSIDE
from casashell.io.staging import staged_file
from casashell.io.studio import Curves, Dots, Layer, PicturesUnavailable, Studio
from casashell.io.tessellate import Surface
from casashell.typing import AnyArray, FloatArray

_INSTALL: Final = "pip install av pyvista matplotlib pillow, or casashell with the extra 'viz'"
_SUFFIXES: Final = (".mp4", ".gif")
_INK: Final = "#23272e"
_SOFT: Final = "#5d6672"
_LINE: Final = "#274f7d"
# GIF counts in hundredths of a second, and players slow down what is shorter than two.
_GIF_FPS: Final = 25.0
# Lines are drawn this share of the picture's height nearer to the eye, out of their own surface.
_LIFT: Final = 0.004


class MovieUnavailable(PicturesUnavailable):
    """A package that makes films is not installed; the message says how to get it."""


class _Film(Protocol):
    """Takes pictures one by one."""

    def __enter__(self) -> _Film: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def add(self, picture: AnyArray) -> None: ...


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
    film_kind = _Gif if gif else _Mp4
    title = _Title(animation, height)
    _check_pyvista()
    with staged_file(file, overwrite=overwrite) as temporary, film_kind(temporary, rate) as film:
        for count, picture in enumerate(_pictures(animation, shown, height, contacts)):
            film.add(title.over(picture, int(shown[count])))
            if progress is not None:
                progress(count + 1, len(shown))
    return file


def picked_frames(animation: Animation, fps: float, speed: float = 1.0) -> AnyArray:
    """Frame (n,) nearest in time to each picture of a film with ``fps`` pictures a second."""
    times = animation.times - animation.times[0]
    count = math.floor(times[-1] * fps / speed + 1e-6) + 1
    wanted = np.arange(count) * speed / fps
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
        ruled = track.lines is not None
        yield Layer(surface, SHELL, SHELL_INSIDE, edges=not ruled, creases=not track.orientable)
    if track.lines is not None and track.lines.shape[1]:
        yield Curves(tuple(_lifted(track.lines[frame], camera)), _LINE, 2.0)
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
        raise MovieUnavailable(f"films need pyvista ({error}): {_INSTALL}") from error


@dataclass(eq=False)
class _Title:
    """Title, time and caption in the corners of a picture.  MovieUnavailable without pillow."""

    animation: Animation
    height: int

    def __post_init__(self) -> None:
        try:
            from matplotlib.font_manager import findfont
            from PIL import Image, ImageDraw, ImageFont
        except ImportError as error:
            raise MovieUnavailable(
                f"films need pillow and matplotlib ({error}): {_INSTALL}"
            ) from error
        self._image, self._draw = Image, ImageDraw
        small = max(round(0.024 * self.height), 9)
        self._fonts = [ImageFont.truetype(findfont("DejaVu Sans"), n) for n in (small + 3, small)]

    def over(self, picture: AnyArray, frame: int) -> AnyArray:
        """The picture with the words of a frame."""
        image = self._image.fromarray(picture)
        draw = self._draw.Draw(image)
        edge, (width, height) = round(0.025 * self.height), image.size
        large, small = self._fonts
        clock = f"{self.animation.times[frame]:.2f} s"
        draw.text((edge, edge), self.animation.title, _INK, large)
        draw.text((width - edge, edge), clock, _SOFT, small, anchor="ra")
        if self.animation.captions:
            caption = self.animation.captions[frame]
            draw.text((edge, height - edge), caption, _SOFT, small, anchor="ld")
        return np.asarray(image)


class _Mp4:
    """H.264 that plays everywhere: even sizes, 4:2:0, the index in front."""

    def __init__(self, path: Path, fps: float) -> None:
        try:
            import av
        except ImportError as error:
            raise MovieUnavailable(f"MP4 needs PyAV ({error}): {_INSTALL}") from error
        from fractions import Fraction

        self._av, self._path = av, path
        self._rate = Fraction(fps).limit_denominator(1001)
        self._stream: Any = None

    def __enter__(self) -> _Mp4:
        options = {"movflags": "+faststart"}
        self._file = self._av.open(str(self._path), "w", format="mp4", options=options)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None and self._stream is not None:
            self._file.mux(self._stream.encode())
        self._file.close()

    def add(self, picture: AnyArray) -> None:
        height, width = (n - n % 2 for n in picture.shape[:2])
        if self._stream is None:
            options = {"crf": "20", "preset": "medium"}
            self._stream = self._file.add_stream("libx264", rate=self._rate, options=options)
            self._stream.width, self._stream.height = width, height
            self._stream.pix_fmt = "yuv420p"
        even = np.ascontiguousarray(picture[:height, :width])
        self._file.mux(self._stream.encode(self._av.VideoFrame.from_ndarray(even, format="rgb24")))


class _Gif:
    """One palette for all pictures, that of the first: nothing flickers."""

    def __init__(self, path: Path, fps: float) -> None:
        from PIL import Image  # there, or the title would have said so

        self._image, self._path, self._fps = Image, path, fps
        self._pictures: list[Any] = []

    def __enter__(self) -> _Gif:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None or not self._pictures:
            return
        # Hundredths of a second, rounded so that the sum stays right.
        marks = np.rint(100.0 * np.arange(len(self._pictures) + 1) / self._fps)
        self._pictures[0].save(
            self._path,
            save_all=True,
            append_images=self._pictures[1:],
            duration=[int(10 * step) for step in np.maximum(np.diff(marks), 2)],
            loop=0,
            optimize=False,
        )

    def add(self, picture: AnyArray) -> None:
        image = self._image.fromarray(picture)
        if not self._pictures:
            self._pictures.append(image.quantize(256, dither=self._image.Dither.NONE))
        else:
            palette = self._pictures[0]
            self._pictures.append(image.quantize(palette=palette, dither=self._image.Dither.NONE))
