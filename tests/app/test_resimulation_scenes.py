"""The nine examples: their materials, what is measured of an act, and two acts that are quick."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import casashell
from casashell.app.resimulation_scenes import Act, Example, Spell, examples, measured, swung
from casashell.result import Result

#: Ly 2018, Table 1: density, k_L, k_theta, friction.
TABLE = {
    "Synthetic Skirt": (0.1, 3.0, 5e-3, 0.6),
    "Book Page": (10.0, 5.0, 2e-3, 0.4),
    "Beret": (0.25, 5e-2, 5e-4, 0.3),
    "Floppy Hat": (2.5, 5.0, 5e-4, 0.6),
    "Top": (0.5, 0.2, 0.1, 0.2),
    "Saroual": (0.05, 1.0, 1e-2, 0.2),
    "Puff Sleeve": (1.0, 0.1, 1e-3, 0.7),
    "Gored Skirt": (0.05, 0.8, 5e-3, 0.7),
    "ClothCap Shirt": (1.0, 3.0, 5e-4, 0.2),
}


def _named(title: str, data: Path | None = None) -> Example:
    (found,) = (one for one in examples(data)[0] if one.title == title)
    return found


def _materials(found: list[Example]) -> dict[str, tuple[float, ...]]:
    made = {}
    for one in found:
        scene = one.make()
        of, (body,) = scene.material, scene.obstacles
        made[one.title] = (of.density, of.stretch, of.bend, body.friction)
    return made  # type: ignore[return-value]


def test_without_data_real_garments_are_named() -> None:
    found, skipped = examples()
    assert [one.title for one in found] == [
        "Synthetic Skirt",
        "Book Page",
        "Beret",
        "Floppy Hat",
        "Puff Sleeve",
    ]
    assert [line.split(":")[0] for line in skipped] == [
        "Top",
        "Saroual",
        "Gored Skirt",
        "ClothCap Shirt",
    ]
    assert _materials(found) == {one.title: TABLE[one.title] for one in found}


def test_materials_are_those_of_the_paper(shared_data: Path) -> None:
    found, skipped = examples(shared_data)
    assert skipped == []
    assert _materials(found) == TABLE
    assert all(one.acts and all(act.claims for act in one.acts) for one in found)


def test_a_spell_rises_and_dies_down() -> None:
    """Closed form: linear ramps of 0.2 s at the start and from 1 s on."""
    wind = Spell((3.0, 0.0, 0.0), onset=0.2, until=1.0)
    speeds = [wind.at(t)[0] for t in (0.0, 0.1, 0.2, 1.0, 1.1, 1.2, 5.0)]
    assert speeds == pytest.approx([0.0, 1.5, 3.0, 3.0, 1.5, 0.0, 0.0])
    sudden = Spell((3.0, 0.0, 0.0), until=1.0)
    assert [sudden.at(t)[0] for t in (0.0, 0.99, 1.01)] == [3.0, 3.0, 0.0]


def test_a_body_is_swung_both_ways_and_ends_at_rest() -> None:
    motion = swung(30.0, 0.8, times=2)
    angles = [np.degrees(np.arctan2(*motion.at(t)[0][0, [2, 0]])) for t in np.linspace(0, 1.6, 201)]
    assert max(angles) == pytest.approx(30.0, rel=0.02)
    assert min(angles) == pytest.approx(-30.0, rel=0.02)
    assert abs(angles[1]) + abs(angles[-2]) < 0.02 * 30.0
    assert [angles[0], angles[-1]] == pytest.approx([0.0, 0.0], abs=1e-9)


@pytest.fixture(scope="module")
def skirt() -> Result:
    return casashell.solve(_named("Synthetic Skirt").make().problem).require()


def test_what_moves_with_the_body_does_not_slip(skirt: Result) -> None:
    """A shell carried by hand: no slip, no speed against the body; held by hand: both, closed form."""
    still = casashell.simulate(skirt, 0.1)
    act = Act("turn", 0.1, motion=swung(10.0, 0.1))
    carried = np.empty_like(still.positions)
    for k, time in enumerate(still.times):
        turn, shift = act.motion.at(float(time))  # type: ignore[union-attr]
        carried[k] = skirt.pose @ turn.T + shift
    rate = np.gradient(carried, still.times, axis=0)
    rate[-1] = (carried[-1] - carried[-2]) * 60.0
    rides = measured(act, skirt, replace(still, positions=carried, velocities=rate))
    assert rides["slip"] < 1e-12
    assert rides["end speed"] < 1e-9
    stays = measured(act, skirt, still)
    ids = skirt.contacts.vertices
    turns = [np.linalg.norm(skirt.pose[ids] - x[ids], axis=1).max() for x in carried]
    assert stays["slip"] == pytest.approx(max(turns) / still.size, rel=1e-6)
    assert stays["touching"] == 1.0


def test_the_skirt_does_in_the_wind_what_is_claimed(skirt: Result) -> None:
    (act,) = _named("Synthetic Skirt").acts
    found = measured(act, skirt, act.play(skirt))
    assert act.complaints(found) == []
    missed = replace(act, claims={"drift": (2.0, 3.0)})
    assert missed.complaints(found) == [f"wind: drift is {found['drift']:.3g}, not 2 .. 3"]


@pytest.mark.slow
def test_a_page_slides_sticks_and_flips() -> None:
    """Ly 2018, Sec. 8.2: weak and strong wind."""
    page = _named("Book Page")
    result = casashell.solve(page.make().problem).require()
    for act in page.acts:
        assert act.complaints(measured(act, result, act.play(result))) == []
