"""Numbers as people read them: engineering prefixes, round limits, plain status words."""

from __future__ import annotations

import math
from typing import Final

from casashell.status import Status

_PREFIXES: Final = {-4: "p", -3: "n", -2: "µ", -1: "m", 0: "", 1: "k", 2: "M", 3: "G"}
_ROUNDING: Final = 1e-12
_MINUS: Final = "\N{MINUS SIGN}"

STATUS_WORDS: Final = {
    Status.SOLVED: "Solved: a stable frictional equilibrium, certified",
    Status.SOLVED_NEARBY: "Solved nearby: certified, but the pose is not exactly the target",
    Status.UNSTABLE: "Not solved: the equilibrium found is not stable",
    Status.CONE_VIOLATED: "Not solved: some contact forces need more friction or pull on the body",
    Status.INFEASIBLE: "Impossible: proved that no natural shape exists for this scene",
    Status.TOO_SOFT: "Not solved: the material is too soft for this shape and weight",
    Status.ITERATION_LIMIT: "Not solved: the iteration limit was reached",
    Status.INTERRUPTED: "Interrupted: the best shape so far, not certified",
    Status.NONFINITE: "Not solved: the computation broke down with numbers that are not finite",
}


def engineering(value: float, unit: str = "", digits: int = 3) -> str:
    """``value`` with ``digits`` significant digits and an SI prefix: 0.01234, "N" -> "12.3 mN".

    Without a unit the prefix becomes a power of ten.  Zero and what is not finite stay themselves.
    """
    if not math.isfinite(value):
        return ("∞" if value > 0 else f"{_MINUS}∞") if math.isinf(value) else "not a number"
    if value == 0:
        return f"0 {unit}".rstrip()
    rounded = float(f"{value:.{digits - 1}e}")
    exponent = math.floor(math.log10(abs(rounded)))
    third = exponent // 3
    if not unit:
        if -3 <= exponent < 5:
            return _signed(f"{rounded:.{max(digits - 1 - exponent, 0)}f}")
        return _signed(f"{rounded / 10.0**exponent:.{digits - 1}f}e{exponent}")
    third = min(max(third, min(_PREFIXES)), max(_PREFIXES))
    scaled = rounded / 10.0 ** (3 * third)
    places = max(digits - 1 - (exponent - 3 * third), 0)
    if places > digits + 2 or abs(scaled) >= 1e6:  # beyond the prefixes
        return _signed(f"{rounded:.{digits - 1}e} {unit}")
    return _signed(f"{scaled:.{places}f} {_PREFIXES[third]}{unit}")


def percent(value: float, digits: int = 3) -> str:
    """A ratio as a percentage: 0.01234 -> "1.23 %"; rounding errors are 0."""
    return f"{_signed(f'{100 * _clean(value):.{digits}g}')} %"


def degrees(value: float, digits: int = 3) -> str:
    """An angle in radians as degrees: 0.5 -> "28.6°"; rounding errors are 0."""
    return f"{_signed(f'{math.degrees(_clean(value)):.{digits}g}')}°"


def _clean(value: float) -> float:
    """The value, or zero when it is rounding of quantities around one."""
    return 0.0 if abs(value) < _ROUNDING else value


def round_up(value: float) -> float:
    """Smallest of 1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten that is >= value; 0 stays 0."""
    if not value > 0 or not math.isfinite(value):
        return 0.0
    power = 10.0 ** math.floor(math.log10(value))
    for step in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0):
        if step * power >= value * (1 - 1e-9):
            return step * power
    return 10.0 * power


def prefix_for(value: float) -> tuple[float, str]:
    """Factor and SI prefix that bring ``value`` between 1 and 1000: 0.02 -> (1000.0, "m")."""
    if not value > 0 or not math.isfinite(value):
        return 1.0, ""
    third = min(max(math.floor(math.log10(value) / 3 + 1e-9), min(_PREFIXES)), max(_PREFIXES))
    return 10.0 ** (-3 * third), _PREFIXES[third]


def _signed(text: str) -> str:
    """The text with a typographic minus sign."""
    return text.replace("-", _MINUS)
