"""Seconds of a ribbon's gradient over its segments: chain rule O(N^2), adjoint O(N)."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.timing import Goal, best
from casashell.ribbon.chain import Strip, pull_back, strip
from casashell.ribbon.gradients import by_chain_rule, by_two_passes
from casashell.typing import FloatArray

SHORT, LONG = (50, 100, 200, 400, 800), (800, 1600, 3200, 6400, 12800)


def wavy(segments: int) -> tuple[Strip, FloatArray]:
    """A strip, and the derivative of some energy by its station table."""
    at = np.linspace(0.0, 1.0, segments + 1)
    c, beta = 0.3 * np.sin(9.0 * at), 3.0 / segments * np.cos(7.0 * at)
    c[0] = c[-1] = 0.0
    shape = strip(10.0, 0.2, c, beta, np.eye(3), np.zeros(3))
    return shape, np.sin(np.arange(12.0 * (segments + 1))).reshape(-1, 3)


def gradients() -> tuple[list[Goal], list[str]]:
    """Goals on the exponents, and the lines of a table [ms]."""
    lines = ["| segments | chain rule ms | adjoint ms | two passes ms |", "|---|---|---|---|"]
    chain, adjoint = {}, {}
    for n in sorted({*SHORT, *LONG}):
        shape, g = wavy(n)
        adjoint[n] = best(partial(pull_back, shape, g), 9)
        cells = [f"{n}", "", f"{1e3 * adjoint[n]:.3f}", ""]
        if n in SHORT:
            chain[n] = best(partial(by_chain_rule, shape, g), 3)
            cells[1] = f"{1e3 * chain[n]:.3f}"
            cells[3] = f"{1e3 * best(partial(by_two_passes, 10.0, shape, g), 3):.3f}"
        lines.append("| " + " | ".join(cells) + " |")
    fast = _exponent({n: adjoint[n] for n in LONG})
    slow = _exponent(chain)
    lines += [
        "",
        f"Exponents: chain rule {slow:.2f}, adjoint {fast:.2f} from {LONG[0]} segments on.",
    ]
    goals = [
        Goal("exponent of the adjoint gradient", fast, 1.2, ""),
        Goal("exponent of the chain rule", slow, 1.7, "", at_most=False),
    ]
    return goals, lines


def _exponent(times: dict[int, float]) -> float:
    return float(np.polyfit(np.log(list(times)), np.log(list(times.values())), 1)[0])
