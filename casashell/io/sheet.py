"""Rendered panels with labels and colour bars: single pictures and the overview sheet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from casashell.io.colours import ColourMap
from casashell.io.studio import INSTALL, PicturesUnavailable
from casashell.typing import AnyArray

_DPI: Final = 100
_GAP: Final = 28
_CAPTION: Final = 50
_BAR: Final = 78
_INK: Final = "#23272e"


@dataclass(frozen=True, eq=False)
class ColourBar:
    """Colour bar below a panel: ``label (unit)`` with ticks at ``factor`` times the value."""

    colours: ColourMap
    label: str
    unit: str
    factor: float = 1.0


@dataclass(frozen=True, eq=False)
class Panel:
    """One rendered view (height, width, 3) uint8, a few words, and perhaps a colour bar."""

    name: str
    label: str
    picture: AnyArray
    bar: ColourBar | None = None


def write_panel(panel: Panel, path: Path) -> Path:
    """One panel as a PNG of its own."""
    return write_sheet([[panel]], path)


def write_sheet(rows: Sequence[Sequence[Panel]], path: Path, shrink: float = 1.0) -> Path:
    """Panels of equal size in rows as one PNG; several are lettered (a), (b), ... in order.

    shrink  scale of the pictures (not of the text); below 1 for a sheet that is shown small

    PicturesUnavailable: pillow or matplotlib is missing.
    """
    image = _pillow()
    height, width = (round(shrink * n) for n in rows[0][0].picture.shape[:2])
    feet = [_CAPTION + (_BAR if any(panel.bar for panel in row) else 0) for row in rows]
    columns = max(len(row) for row in rows)
    total_width = columns * width + (columns + 1) * _GAP
    total_height = sum(height + foot for foot in feet) + _GAP * (len(rows) + 1)
    sheet = image.new("RGB", (total_width, total_height), "white")
    figure = _figure(total_width, total_height)
    top, letter = _GAP, 0
    for row, foot in zip(rows, feet):
        for column, panel in enumerate(row):
            left = _GAP + column * (width + _GAP)
            picture = image.fromarray(panel.picture)
            sheet.paste(picture.resize((width, height), image.Resampling.LANCZOS), (left, top))
            mark = f"({chr(ord('a') + letter)})  " if columns > 1 else ""
            _foot(figure, panel, mark, left, top + height, width)
            letter += 1
        top += height + foot + _GAP
    figure.canvas.draw()
    text = image.fromarray(np.array(figure.canvas.buffer_rgba()))
    sheet.paste(text, (0, 0), text)
    sheet.save(path)
    return path


def _pillow() -> Any:
    """Pillow's Image module; PicturesUnavailable without it."""
    try:
        from PIL import Image
    except ImportError as error:
        raise PicturesUnavailable(f"pictures need pillow ({error}): {INSTALL}") from error
    return Image


def _figure(width: int, height: int) -> Any:
    """An empty figure of that many pixels; PicturesUnavailable without matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise PicturesUnavailable(f"pictures need matplotlib ({error}): {INSTALL}") from error
    # Half a pixel more than asked: the size in inches must not round down to one pixel less.
    size = ((width + 0.5) / _DPI, (height + 0.5) / _DPI)
    figure = Figure(figsize=size, dpi=_DPI, facecolor="none")
    FigureCanvasAgg(figure)
    return figure


def _foot(figure: Any, panel: Panel, mark: str, left: int, top: int, width: int) -> None:
    """Caption and colour bar below a panel whose lower left corner is (left, top) in pixels."""
    full_width, full_height = figure.get_size_inches() * _DPI
    caption = figure.text(
        (left + 0.5 * width) / full_width,
        1 - (top + 0.5 * _CAPTION) / full_height,
        mark + panel.label,
        ha="center",
        va="center",
        fontsize=15.5,
        color=_INK,
    )
    wide = caption.get_window_extent(figure.canvas.get_renderer()).width
    if wide > width:
        caption.set_fontsize(caption.get_fontsize() * width / wide)
    if panel.bar is None:
        return
    length = min(0.72 * width, 520.0)
    box = (
        (left + 0.5 * (width - length)) / full_width,
        1 - (top + _CAPTION + 14) / full_height,
        length / full_width,
        16 / full_height,
    )
    _bar(figure, panel.bar, box)


def _bar(figure: Any, bar: ColourBar, box: tuple[float, float, float, float]) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize
    from matplotlib.ticker import MaxNLocator

    low, high = bar.colours.low, bar.colours.high
    table = bar.colours.rgb(np.linspace(low, high, 256)) / 255.0
    scale = Normalize(low * bar.factor, high * bar.factor)
    # Ends are pointed where values lie beyond the range.
    ends = "neither" if not bar.colours.clipped else ("both" if low < 0 else "max")
    axes = figure.add_axes(box)
    drawn = figure.colorbar(
        ScalarMappable(scale, ListedColormap(table)),
        cax=axes,
        orientation="horizontal",
        extend=ends,
        extendfrac=0.03,
        ticks=MaxNLocator(nbins=6, steps=[1, 2, 2.5, 3, 4, 5, 10]),
    )
    drawn.outline.set_edgecolor("#8a8f98")
    drawn.outline.set_linewidth(0.7)
    axes.tick_params(labelsize=12.5, colors=_INK, length=3, pad=3)
    axes.set_xlabel(f"{bar.label} [{bar.unit}]", fontsize=13, color=_INK, labelpad=3)
