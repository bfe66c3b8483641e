"""Weak Wolfe line search by bisection; points that cannot be evaluated count as infinitely high."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

#: Sufficient decrease and flattening of the slope (Nocedal and Wright 2006, Sec. 3.1).
DECREASE, FLATTER = 1e-4, 0.9
#: A low point this near to where the value jumps, as angles of folds do, will not become flatter.
CLOSE = 0.3


@dataclass(frozen=True)
class Trial:
    """A point on the line: value and slope there.  NaN or infinity: not acceptable."""

    step: float
    value: float
    slope: float

    @property
    def usable(self) -> bool:
        """Whether both numbers are finite."""
        return math.isfinite(self.value) and math.isfinite(self.slope)


def weak_wolfe(
    evaluate: Callable[[float], Trial],
    here: Trial,
    *,
    first: float = 1.0,
    longest: float = math.inf,
    noise: float = 0.0,
    tries: int = 25,
) -> Trial | None:
    """First trial that falls enough and is flat enough; None when no step lowers the value.

    Before a jump of the value a low point may stay steep; then falling is enough.

    here     the start of the line: step 0, with a negative slope
    first    first step tried; doubled up to ``longest`` while the slope stays steep
    noise    rounding of the values: differences below it are judged by the slope alone, which is
             accurate where the values no longer are (Hager and Zhang 2005)
    """
    low, high, step = 0.0, math.inf, min(first, longest)
    best: Trial | None = None
    for _ in range(tries):
        trial = evaluate(step)
        if trial.usable and abs(trial.slope) <= -FLATTER * here.slope:
            lost_in_noise = abs(trial.value - here.value) <= noise
            if lost_in_noise or trial.value <= here.value + DECREASE * step * here.slope:
                return trial
        falls = trial.usable and trial.value <= here.value + DECREASE * step * here.slope
        if falls and trial.slope >= FLATTER * here.slope:  # beyond the minimum, but low enough
            return trial
        if falls:
            best, low = trial, step
        else:
            high = step
        if best is not None and (low >= longest or high - low <= CLOSE * low):
            return best
        step = min(2.0 * low, longest) if math.isinf(high) else 0.5 * (low + high)
    return best
