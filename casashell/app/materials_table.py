"""What `casashell materials` prints: ranges in words, a table of named materials, the same for programs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from casashell.app.materials import Findings, Verdict
from casashell.app.scene import Scene
from casashell.inverse.material_range import MaterialRange
from casashell.inverse.softest import STARTS, Softest
from casashell.io.labels import engineering
from casashell.status import Status

_ENDS: Final = {
    "unstable": "the shape becomes unstable",
    "no equilibrium": "no natural shape was found",
    "slides": "the contacts slide",
    "stopped": "the search was stopped there",
    "tested no further": "tested no further",
    "no contact forces": "no admissible contact forces",
}
_UNITS: Final = {"stretch": "N", "bend": "J"}


def lines_of(scene: Scene, found: Findings) -> Iterator[str]:
    """The whole report."""
    yield ""
    yield from _ranges(scene, found.range)
    if found.verdicts:
        yield ""
        yield from _table(found.verdicts, _least_friction(scene, found.range))
    yield from _summary(found)
    fit = found.calibration
    if fit is not None:
        yield ""
        yield (
            f"On this mesh k_L = {engineering(fit.stretch, 'm')} x membrane stiffness and "
            f"k_theta = {fit.bend:.3g} x bending rigidity; locally the sheet is "
            f"{_spread(fit.stretch_range)} times as stiff in its plane and "
            f"{_spread(fit.bend_range)} times in bending (80 % of the area)."
        )
    yield f"{found.seconds:.1f} s"


def _ranges(scene: Scene, known: MaterialRange) -> Iterator[str]:
    together = known.together
    if together is None:
        yield "Nothing was solved before the interrupt."
        return
    if together.factor == 0.0:
        yield (
            f"No material was found that holds this target (stiffer by up to {1 / STARTS[-1]:.1g}): "
            f"{_ENDS.get(together.reason, together.reason)}. casashell invert says more."
        )
        return
    if together.factor < 1.0:
        yield (
            f"Too soft: all stiffnesses {1 / together.factor:.3g} times as large, or a weight as many "
            "times smaller, were solved."
        )
        return
    density = float(np.mean(scene.material.density))
    yield "Holds with (the others as given):"
    for name, one in known.alone.items():
        value = float(np.mean(getattr(scene.material, name, np.nan)))
        upper = (
            f"{_value(known.stiffer[name] * value, name)} (tested)" if name in known.stiffer else ""
        )
        yield f"  {name:<12}from {_value(value / one.factor, name)} to at least {upper}{_end(one)}"
    heavy = together.factor * density
    yield f"  {'density':<12}from 0 to {heavy:.3g} kg/m2{_end(together)}"
    yield f"  {'all softer':<12}by up to {together.factor:.3g} times, stretch and bend together"
    yield from _friction(scene, known)


def _friction(scene: Scene, known: MaterialRange) -> Iterator[str]:
    least = _least_friction(scene, known)
    if least is None or known.friction is None:
        return
    given = least / known.friction.solved if known.friction.solved else 1.0
    text = f"  {'friction':<12}from {least:.2g} up"
    if known.friction.failed:
        text += f" (not found at {given * known.friction.failed:.2g})"
    if known.friction.impossible:
        text += (
            f"; proved impossible at {given * known.friction.impossible:.2g}, whatever the material"
        )
    yield text


def _least_friction(scene: Scene, known: MaterialRange) -> float | None:
    """Smallest friction that was solved, for the roughest contact."""
    if known.friction is None or len(scene.problem.contacts) == 0:
        return None
    return known.friction.solved * float(scene.problem.contacts.friction.max())


def _table(verdicts: list[Verdict], least: float | None) -> Iterator[str]:
    yield f"{'material':<14}{'kg/m2':>7}{'N/m':>9}{'N m':>9}{'stretch':>10}{'bend':>10}  verdict"
    for each in verdicts:
        sheet = each.sheet
        yield (
            f"{sheet.name:<14}{sheet.density:>7.3g}{sheet.membrane:>9.2g}{sheet.rigidity:>9.1e}"
            f"{each.stretch:>10.3g}{each.bend:>10.2e}  {_verdict(each, least)}"
        )


def _verdict(each: Verdict, least: float | None) -> str:
    if each.status is Status.SOLVED:
        low, high = each.sheet.friction
        if least is not None and low < least:
            return f"{each.status}; slides on skin below {least:.2g} (it has {low:g} to {high:g})"
        return str(each.status)
    if each.factor <= 0.0:
        tried = f", down to {each.failed:.1g} of the load" if each.failed else ""
        return f"undecided: nothing was solved{tried}"
    return f"{each.status}: solved when {1 / each.factor:.2g} times as stiff for its weight"


def _summary(found: Findings) -> Iterator[str]:
    good = [each.sheet for each in found.verdicts if each.status is Status.SOLVED]
    if not good:
        if found.verdicts:
            yield "None of these holds the target."
        return
    softest = min(good, key=lambda sheet: sheet.rigidity)
    heaviest = max(good, key=lambda sheet: sheet.density)
    slippery = min(good, key=lambda sheet: sheet.friction[0])
    yield (
        f"Hold the target: {', '.join(sheet.name for sheet in good)}. Softest {softest.name}, "
        f"heaviest {heaviest.name}, most slippery {slippery.name}."
    )


def _end(one: Softest) -> str:
    """How the range ends on its soft side."""
    why = _ENDS.get(one.reason, one.reason)
    if one.failed is None:
        return f"; {why}"
    return f"; {100.0 * (one.failed / one.factor - 1.0):.0f} % beyond, {why}"


def _value(value: float, name: str) -> str:
    return f"{value:.3g} {_UNITS.get(name, '')}".rstrip()


def _spread(values: tuple[float, float]) -> str:
    return f"{values[0]:.2g} to {values[1]:.2g}"


def record_of(found: Findings) -> dict[str, Any]:
    """Everything for programs; factors multiply the material of the scene."""
    known, fit, friction = found.range, found.calibration, found.range.friction
    record: dict[str, Any] = {
        "complete": known.complete and not found.interrupted,
        "seconds": found.seconds,
        "softest_factor": known.together.factor if known.together else None,
        "together": _softest_record(known.together),
        "alone": {name: _softest_record(one) for name, one in known.alone.items()},
        "stiffer_tested": dict(known.stiffer),
        "friction": None,
        "calibration": None,
        "materials": [each.record for each in found.verdicts],
    }
    if friction is not None:
        record["friction"] = {
            "solved": friction.solved,
            "failed": friction.failed,
            "impossible": friction.impossible,
        }
    if fit is not None:
        record["calibration"] = {
            "stretch_per_membrane": fit.stretch,
            "bend_per_rigidity": fit.bend,
            "stretch_range": list(fit.stretch_range),
            "bend_range": list(fit.bend_range),
        }
    return record


def _softest_record(found: Softest | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {"factor": found.factor, "failed": found.failed, "reason": found.reason}
