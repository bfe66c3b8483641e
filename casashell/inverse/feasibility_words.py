"""The answers of `casashell.feasibility` in sentences and as plain data."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from casashell.inverse.feasibility_proof import STRENGTH
from casashell.inverse.feasibility_states import LARGE_FOLD, LARGEST_FOLD, LARGEST_STRETCH
from casashell.typing import IntArray

if TYPE_CHECKING:
    from casashell.inverse.feasibility import Feasibility, PartFeasibility

_SHOWN = 6
_RECORDED = 1000
#: Displacement, relative to the largest, from which a vertex counts as moving.
_MOVES = 1e-2


def summary(found: Feasibility) -> tuple[str, ...]:
    """Sentences for every part, the worst parts first."""
    from casashell.inverse.feasibility import Verdict

    order = list(Verdict)
    parts = sorted(found.parts, key=lambda part: -order.index(part.verdict))
    lines: list[str] = []
    for part in parts:
        where = ""
        if len(parts) > 1:
            where = f"Part with vertex {int(part.vertices[0])} ({len(part.vertices)} vertices): "
        sentences = list(_sentences(part))
        lines += [where + sentences[0], *sentences[1:]]
    return tuple(lines)


def ids(vertices: IntArray) -> str:
    """``vertices 3, 17, 42 and 5 more``."""
    shown = ", ".join(str(int(v)) for v in vertices[:_SHOWN])
    more = f" and {len(vertices) - _SHOWN} more" if len(vertices) > _SHOWN else ""
    return f"{'vertex' if len(vertices) == 1 else 'vertices'} {shown}{more}"


def _sentences(part: PartFeasibility) -> Iterator[str]:
    if part.reason in ("rigid", "stresses"):
        yield from _impossible(part)
    elif part.reason == "masses":
        yield from _other_masses(part)
    elif part.reason == "program":
        yield (
            "Not decided: the stress program ended without an answer, which badly shaped triangles "
            "or stiffnesses of very different size can cause (casashell check)."
        )
    elif part.reason == "measures":
        yield "Not decided: contacts and pins can carry the whole, the stresses were not tested."
    else:
        yield from _held(part)
    yield from (f"Note: {note}." for note in part.notes)


def _impossible(part: PartFeasibility) -> Iterator[str]:
    proof = part.proof
    if proof is None:
        raise ValueError(f"a part with reason '{part.reason}' needs its certificate")
    material = (
        "whatever its material"
        if proof.rigid
        else "whatever the stiffness of the edges and hinges that have any"
    )
    masses = (
        "whatever its masses"
        if np.isinf(proof.area_factor)
        else f"as long as its areas are within a factor of {proof.area_factor:g} of the target's"
    )
    scope = f"{material} and {masses}"
    if proof.holds:
        yield f"Proved: no natural shape holds this target, {scope}."
        checked = "Checked again without the solver: "
        if np.isinf(proof.strength):
            checked += "no stress and no contact force resists this motion."
        else:
            checked += f"balance would take forces of {proof.strength:.0e} times the weight."
    else:
        yield f"Most likely no natural shape holds this target, {scope}; this is not a proof."
        checked = (
            f"The certificate rules out forces up to {proof.strength:.1e} times the weight only "
            f"(a proof: {STRENGTH:.0e})."
        )
    yield from _motion(part)
    yield checked
    yield from _mend(part)


def _motion(part: PartFeasibility) -> Iterator[str]:
    """What moves in the proof."""
    proof, mending = part.proof, part.mending
    if proof is None:
        return
    moving = part.vertices[np.linalg.norm(proof.motion, axis=1) > _MOVES]
    kind = "the shell moves as a whole" if proof.rigid else f"{ids(moving)} move"
    how = "without straining anything and the weight does work"
    if mending is not None and len(mending.sliding):
        how += f"; contacts at {ids(part.vertices[mending.sliding])} slide along"
    if mending is not None and len(mending.lifting):
        how += f"; contacts at {ids(part.vertices[mending.lifting])} lift off"
    yield f"Why: {kind} {how}."
    if not proof.rigid:
        yield (
            "Neither tensions along the edges nor the bending moments there act along this motion: "
            "give the hinges there bending stiffness, or curve the target."
        )


def _mend(part: PartFeasibility) -> Iterator[str]:
    mending = part.mending
    if mending is None:
        return
    rigid = part.reason != "stresses"
    if rigid and len(part.contacts) == 0:
        yield "It is not held well enough: no contacts; raise the contact tolerance or add obstacles."
    elif rigid and mending.friction is not None:
        yield (
            f"It takes a friction of about {mending.friction:.2g} "
            f"(the least now is {part.friction or 0.0:.2g})."
        )
    elif rigid:
        off = ""
        if mending.off_support:
            off = f": the centre of mass lies {mending.off_support:.3g} m beyond their polygon"
        yield f"No friction is enough: the contacts do not support the weight{off}."
    if mending.pins:
        pins = part.vertices[np.array(mending.pins)]
        does = "mends it" if mending.pins_suffice else "helps and is not enough"
        yield f"Pinning {ids(pins)} {does}."


def _other_masses(part: PartFeasibility) -> Iterator[str]:
    if part.mending is None:
        yield (
            "Doubtful: at the target's masses no stresses are in balance, only with natural areas "
            "other than the target's."
        )
        return
    if part.area_factor is None:
        yield "Most likely infeasible: no contact forces balance the weight; this is not a proof."
    else:
        yield (
            "Doubtful: contacts and pins balance the weight only if natural areas differ from the "
            f"target's by a factor of {part.area_factor:.2f}, which no ordinary natural shape does."
        )
    yield from _mend(part)


def _held(part: PartFeasibility) -> Iterator[str]:
    state, margin = part.state, part.margin
    if state is None:
        yield "Feasible."
        return
    strains = " and ".join(
        text
        for text in (
            None if state.fold is None else f"rest folds up to {state.fold:.2g} rad",
            None if state.stretch is None else f"a stretch up to {100.0 * state.stretch:.2g} %",
        )
        if text
    )
    if part.reason == "folds":
        yield (
            f"Feasible only with {strains}: the material is too soft, a natural shape with folds "
            f"beyond {LARGEST_FOLD:.2f} rad or a stretch beyond {100.0 * LARGEST_STRETCH:.0f} % "
            "does not exist as a mesh. Raise bend (first) and stretch, or lower density."
        )
        return
    if part.reason == "stability" and margin is not None:
        yield _unstable(part)
    else:
        yield f"Feasible, with {strains}."
    if (state.fold or 0.0) > LARGE_FOLD * (1.0 + 1e-6):
        yield (
            f"Warning: natural shapes with folds beyond {LARGE_FOLD:.2f} rad hardly exist as meshes; "
            "a stiffer bend or less density makes it safe."
        )
    if part.area_factor is not None and part.area_factor > 1.0:
        yield f"Natural areas have to differ from the target's by a factor of {part.area_factor:.3f}."
    if state.friction_used is not None:
        yield f"These forces use up to {100.0 * state.friction_used:.0f} % of the friction."
    if margin is not None and margin.stable:
        yield _stable(part)


def _unstable(part: PartFeasibility) -> str:
    margin = part.margin
    if margin is None or margin.scaled is None:
        raise ValueError("a part whose stability failed needs its margin")
    if margin.ended == "time":
        return (
            f"Balanced, but whether stably is not decided: time was up after {margin.rounds} rounds "
            f"of {margin.cuts} stability cuts."
        )
    if abs(margin.scaled) <= 1e-7:
        return (
            "Balanced, but neutral: the shell can move as a rigid body without resistance. Pin "
            "vertices or let more vertices touch (tolerance)."
        )
    found = (
        f"no stresses meet the stability cuts ({margin.cuts})"
        if margin.ended == "no solution"
        else f"no stable stresses were found in {margin.rounds} rounds of {margin.cuts} cuts"
    )
    advice = (
        "The contacts carry it on the edge of their polygon only: let more vertices touch (tolerance) "
        "or pin vertices."
        if (part.area_factor or 1.0) > 1.0
        else "The material is too soft for this pose: raise bend (first) and stretch, or lower density."
    )
    return f"Balanced, but not stably: {found} (lowest eigenvalue {margin.eigenvalue:.2g} N/m). {advice}"


def _stable(part: PartFeasibility) -> str:
    margin = part.margin
    if margin is None or margin.eigenvalue is None:
        return "Stable: no vertex is free to move."
    after = f" after {margin.rounds} rounds of cuts" if margin.rounds else ""
    return (
        f"Stable{after}: lowest eigenvalue {margin.eigenvalue:.3g} N/m under these stresses "
        f"({margin.scaled:.3g} times weight per edge length)."
    )


def record(found: Feasibility) -> dict[str, Any]:
    """Plain data for JSON; numbers that are not finite are null."""
    return {
        "verdict": str(found.verdict),
        "exit_code": found.exit_code,
        "seconds": found.seconds,
        "summary": list(found.summary),
        "parts": [_part_record(part) for part in found.parts],
    }


def _part_record(part: PartFeasibility) -> dict[str, Any]:
    proof, mending, state, margin = part.proof, part.mending, part.state, part.margin
    whole = part.vertices
    return {
        "first_vertex": int(whole[0]),
        "vertices": len(whole),
        "contacts": part.contacts[:_RECORDED].tolist(),
        "friction": part.friction,
        "verdict": str(part.verdict),
        "reason": part.reason,
        "area_factor": part.area_factor,
        "proof": None
        if proof is None
        else {
            "holds": proof.holds,
            "rigid": proof.rigid,
            "any_masses": bool(np.isinf(proof.area_factor)),
            "area_factor": _finite(proof.area_factor),
            "work": proof.work,
            "strength": _finite(proof.strength),
        },
        "mending": None
        if mending is None
        else {
            "friction": mending.friction,
            "pins": whole[np.array(mending.pins, dtype=np.int64)].tolist(),
            "pins_suffice": mending.pins_suffice,
            "off_support": mending.off_support,
            "sliding": whole[mending.sliding][:_RECORDED].tolist(),
            "lifting": whole[mending.lifting][:_RECORDED].tolist(),
        },
        "state": None
        if state is None
        else {
            "tension": state.tension,
            "moment": state.moment,
            "stretch": state.stretch,
            "fold": state.fold,
            "energy": state.energy,
            "friction_used": state.friction_used,
        },
        "stability": None
        if margin is None
        else {
            "stable": margin.stable,
            "eigenvalue": margin.eigenvalue,
            "scaled": margin.scaled,
            "rounds": margin.rounds,
            "cuts": margin.cuts,
            "ended": margin.ended,
        },
        "notes": list(part.notes),
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
