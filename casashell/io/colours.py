"""Colour maps and ranges shared by the pictures and the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from casashell.io.labels import round_up
from casashell.typing import AnyArray, FloatArray

SHELL: Final = "#7fa8d1"
SHELL_INSIDE: Final = "#5c7fa6"
NATURAL: Final = "#e0a95c"
NATURAL_INSIDE: Final = "#b9833b"
OBSTACLE: Final = "#c9c9c6"
PINNED: Final = "#7a3fa0"
CONTACT: Final = "#e2702a"
TOO_MUCH: Final = "#d0021b"

# Anchors (position, red, green, blue): blue for compressed, white for unchanged, red for dilated.
_DIVERGING: Final = (
    (0.00, 8, 48, 107),
    (0.15, 33, 102, 172),
    (0.30, 94, 160, 207),
    (0.42, 190, 217, 235),
    (0.50, 255, 255, 255),
    (0.58, 250, 209, 193),
    (0.70, 234, 122, 99),
    (0.85, 193, 28, 40),
    (1.00, 103, 0, 20),
)
_WHITE_RED: Final = tuple((2 * (p - 0.5), r, g, b) for p, r, g, b in _DIVERGING[4:])
_FRICTION: Final = (
    (0.00, 62, 124, 184),
    (0.50, 52, 172, 146),
    (0.80, 240, 190, 72),
    (1.00, 232, 122, 30),
)


@dataclass(frozen=True)
class ColourMap:
    """Piecewise linear colours over ``[low, high]``; values beyond take the end colours.

    clipped: whether some of the values the range was made for lie beyond it.
    """

    anchors: tuple[tuple[float, int, int, int], ...]
    low: float
    high: float
    clipped: bool = False

    def rgb(self, values: FloatArray) -> AnyArray:
        """Colours (n,3) uint8 of values (n,)."""
        width = self.high - self.low
        table = np.array(self.anchors)
        place = np.clip((values - self.low) / width, 0.0, 1.0)
        channels = [np.interp(place, table[:, 0], table[:, c]) for c in (1, 2, 3)]
        colours: AnyArray = np.rint(np.stack(channels, axis=-1)).astype(np.uint8)
        return colours

    def css(self, steps: int = 16) -> list[tuple[float, str]]:
        """Pairs (position in 0..1, "rgb(r,g,b)")."""
        place = np.linspace(0.0, 1.0, steps + 1)
        colours = self.rgb(self.low + place * (self.high - self.low))
        return [(float(p), f"rgb({r},{g},{b})") for p, (r, g, b) in zip(place, colours)]


def stretch_map(values: FloatArray) -> ColourMap:
    """Blue, white, red on a symmetric range that covers 99 % of the values, at least 0.01 %."""
    limit, clipped = _limit(values, 1e-4)
    return ColourMap(_DIVERGING, -limit, limit, clipped)


def bending_map(values: FloatArray) -> ColourMap:
    """White to red from zero to the 99th percentile of the angles [rad], at least 0.01 degrees."""
    limit, clipped = _limit(np.degrees(values), 1e-2)
    return ColourMap(_WHITE_RED, 0.0, float(np.radians(limit)), clipped)


def friction_map(values: FloatArray) -> ColourMap:
    """Share of the available friction in use; 1 is the edge of Coulomb's cone."""
    return ColourMap(_FRICTION, 0.0, 1.0, bool(np.any(values > 1.0 + 1e-6)))


def _limit(values: FloatArray, least: float) -> tuple[float, bool]:
    """A round range for |values| that a few outliers do not blow up, and whether it cuts any."""
    size = np.abs(values[np.isfinite(values)])
    if not len(size):
        return least, False
    limit = max(round_up(float(np.quantile(size, 0.99))), least)
    return limit, bool(size.max() > limit * (1 + 1e-9))
