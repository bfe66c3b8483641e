"""The history of a solve as one inline SVG: residual of every step on a logarithmic axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Final

from casashell.result import Step

_WIDTH: Final = 760
_HEIGHT: Final = 230
_LEFT: Final = 62
_RIGHT: Final = 16
_TOP: Final = 14
_BOTTOM: Final = 40
_COLOURS: Final = ("#2f6db3", "#d9822b", "#3c8d5a", "#8a4fa3", "#b03a48", "#57707a")


def history_chart(history: Sequence[Step]) -> str:
    """SVG text, or an empty string when fewer than two steps have a positive residual.

    One colour per stage, in order of appearance; steps without a residual are left out.
    """
    points = [
        (number, math.log10(step.residual), step)
        for number, step in enumerate(history)
        if math.isfinite(step.residual) and step.residual > 0
    ]
    if len(points) < 2:
        return ""
    low = math.floor(min(point[1] for point in points))
    high = max(math.ceil(max(point[1] for point in points)), low + 1)
    last = max(len(history) - 1, 1)

    def place(number: float, level: float) -> tuple[float, float]:
        x = _LEFT + (_WIDTH - _LEFT - _RIGHT) * number / last
        y = _TOP + (_HEIGHT - _TOP - _BOTTOM) * (high - level) / (high - low)
        return x, y

    stages = list(dict.fromkeys(point[2].stage for point in points))
    parts = _axes(low, high, last, place(0, low)[1])
    for number, level, step in points:
        x, y = place(number, level)
        colour = _COLOURS[stages.index(step.stage) % len(_COLOURS)]
        title = f"{step.stage}, step {number}: residual {step.residual:.2e}"
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}">'
            f"<title>{escape(title)}</title></circle>"
        )
    path = " ".join("{:.1f},{:.1f}".format(*place(n, level)) for n, level, _ in points)
    line = f'<polyline points="{path}" fill="none" stroke="#b9c0c9" stroke-width="1.2"/>'
    parts.insert(0, line)
    svg = (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" '
        f'aria-label="residual of every step">{"".join(parts)}</svg>'
    )
    return f'<div class="chart">{svg}</div>' + _legend(stages)


def _axes(low: int, high: int, last: int, bottom: float) -> list[str]:
    """Grid lines and labels: decades upwards, steps to the right."""
    parts = []
    stride = max(1, math.ceil((high - low) / 6))
    for level in range(low, high + 1, stride):
        y = _TOP + (_HEIGHT - _TOP - _BOTTOM) * (high - level) / (high - low)
        parts.append(
            f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}" '
            f'stroke="#e3e6ea"/><text x="{_LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">'
            f"1e{level}</text>".replace("e-", "e\N{MINUS SIGN}")
        )
    for number in sorted({0, last // 2, last}):
        x = _LEFT + (_WIDTH - _LEFT - _RIGHT) * number / last
        parts.append(
            f'<text x="{x:.1f}" y="{bottom + 16:.1f}" text-anchor="middle">{number}</text>'
        )
    middle = 0.5 * (_LEFT + _WIDTH - _RIGHT)
    parts.append(f'<text x="{middle}" y="{_HEIGHT - 6}" text-anchor="middle">step</text>')
    upright = _TOP + 0.5 * (_HEIGHT - _TOP - _BOTTOM)
    parts.append(
        f'<text transform="translate(14 {upright}) rotate(-90)" text-anchor="middle">residual</text>'
    )
    return parts


def _legend(stages: Sequence[str]) -> str:
    items = (
        f'<span><i style="background:{_COLOURS[n % len(_COLOURS)]}"></i>{escape(stage)}</span>'
        for n, stage in enumerate(stages)
    )
    return f'<p class="legend">{"".join(items)}</p>'
