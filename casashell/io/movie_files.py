"""Pictures into MP4 and GIF files by PyAV (ffmpeg), one at a time: memory stays flat."""

from __future__ import annotations

from abc import ABC, abstractmethod
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import numpy as np

from casashell.io.colours import CONTACT, OBSTACLE, SHELL, SHELL_INSIDE
from casashell.io.studio import PicturesUnavailable
from casashell.typing import AnyArray

INSTALL: Final = "pip install av pyvista matplotlib pillow, or casashell with the extra 'viz'"


class MovieUnavailable(PicturesUnavailable):
    """A package that makes films is not installed; the message says how to get it."""


class _Film(ABC):
    """A film file that takes pictures (height, width, 3) uint8 of one size.

    MovieUnavailable: PyAV is missing.
    """

    format = ""

    def __init__(self, path: Path, fps: float) -> None:
        try:
            import av
        except ImportError as error:
            raise MovieUnavailable(f"films need PyAV ({error}): {INSTALL}") from error
        self._av, self._path = av, path
        self._rate = Fraction(fps).limit_denominator(1001)
        self._stream: Any = None
        self._count = 0

    def __enter__(self) -> _Film:
        self._file = self._av.open(
            str(self._path), "w", format=self.format, options=self._options()
        )
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
        """The next picture."""
        if self._stream is None:
            self._stream = self._started(picture)
        self._file.mux(self._stream.encode(self._frame(picture)))
        self._count += 1

    def _options(self) -> dict[str, str]:
        return {}

    @abstractmethod
    def _started(self, picture: AnyArray) -> Any:
        """The stream, for pictures of this size."""

    @abstractmethod
    def _frame(self, picture: AnyArray) -> Any:
        """The picture as the encoder takes it."""


class Mp4(_Film):
    """H.264 that plays everywhere: even sizes, 4:2:0, the index in front."""

    format = "mp4"

    def _options(self) -> dict[str, str]:
        return {"movflags": "+faststart"}

    def _started(self, picture: AnyArray) -> Any:
        options = {"crf": "20", "preset": "medium"}
        stream = self._file.add_stream("libx264", rate=self._rate, options=options)
        stream.height, stream.width = (n - n % 2 for n in picture.shape[:2])
        stream.pix_fmt = "yuv420p"
        return stream

    def _frame(self, picture: AnyArray) -> Any:
        even = picture[: self._stream.height, : self._stream.width]
        return self._av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")


class Gif(_Film):
    """One palette for all pictures: nothing flickers, and what stands still takes no room."""

    format = "gif"
    _TICK: Final = Fraction(1, 100)  # s, the clock of this format

    def _started(self, picture: AnyArray) -> Any:
        from PIL import Image

        self._image = Image
        self._palette = Image.fromarray(_with_swatches(picture)).quantize(
            256, dither=Image.Dither.NONE
        )
        rgb = np.array(self._palette.getpalette("RGB"), dtype=np.uint8).reshape(-1, 3)
        self._colours = np.zeros((256, 4), dtype=np.uint8)
        self._colours[:, 0] = 255  # opaque
        self._colours[: len(rgb), 1:] = rgb
        stream = self._file.add_stream("gif", rate=self._rate)
        stream.height, stream.width = picture.shape[:2]
        stream.pix_fmt = "pal8"
        stream.codec_context.time_base = self._TICK
        return stream

    def _frame(self, picture: AnyArray) -> Any:
        image = self._image.fromarray(np.ascontiguousarray(picture))
        indices = image.quantize(palette=self._palette, dither=self._image.Dither.NONE)
        frame = self._av.VideoFrame.from_ndarray((np.array(indices), self._colours), format="pal8")
        frame.time_base = self._TICK
        frame.pts = round(100 * self._count / self._rate)
        return frame


def _with_swatches(picture: AnyArray) -> AnyArray:
    """The picture over shades of all colours that later ones may have."""
    height, width = picture.shape[:2]
    shades = np.linspace(0.1, 1.1, width)[:, None]
    strips = []
    for colour in (SHELL, SHELL_INSIDE, OBSTACLE, CONTACT):
        rgb = np.array([int(colour[n : n + 2], 16) for n in (1, 3, 5)])
        row = np.clip(shades * rgb, 0, 255).astype(np.uint8)
        strips.append(np.broadcast_to(row, (max(height // 12, 1), width, 3)))
    return np.concatenate([picture, *strips])
