"""Wind and damping against closed forms; gusts that repeat."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from meshes import grid
from posed import G, sheet, tilted

from casashell.contact.obstacles import Plane
from casashell.dynamics.simulate import Damping, simulate
from formulations.wind import FaceWind, density


def face_force(turn: np.ndarray, wind: FaceWind, velocity: np.ndarray) -> np.ndarray:
    """Force (3,) of a still step on one face of 0.005 m2."""
    corners = (np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]) @ turn.T).T
    x = ca.SX.sym("x", 3, 3)
    r, p = ca.SX.sym("r", 3, 3), ca.SX.sym("p", 10)
    slope = ca.Function("slope", [x, r, p], [-ca.gradient(density()(x, r, p), x)])
    h = 1e-2
    moved = corners + h * velocity[:, None]
    row = wind.parameters(0.0, h, np.zeros((1, 3)), velocity[None])[0]
    return np.asarray(slope(moved, corners, row)).sum(axis=1)


def test_drag_and_lift_of_a_face() -> None:
    """Square on: rho A C_D u^2 / 2; at 45 degrees the lift is across the stream; edge on: nothing."""
    area, wind = 0.005, FaceWind((0.0, 0.0, 3.0), air=1.2, drag=1.1, lift=0.7)
    still = np.zeros(3)
    assert np.allclose(
        face_force(np.eye(3), wind, still), [0, 0, 0.6 * area * 1.1 * 9.0], rtol=1e-6
    )
    slanted = face_force(tilted(45.0), wind, still)
    c = np.sqrt(0.5)
    assert np.isclose(slanted[2], 0.6 * area * 1.1 * 9.0 * c, rtol=1e-6)
    assert np.isclose(abs(slanted[0]), 0.6 * area * 0.7 * 9.0 * 0.5, rtol=1e-6)
    assert np.abs(face_force(tilted(90.0), wind, still)).max() <= 1e-9
    assert np.abs(face_force(np.eye(3), wind, np.array([0, 0, 3.0]))).max() <= 1e-9


def test_a_falling_sheet_reaches_its_terminal_speed() -> None:
    """m g = rho C_D A v^2 / 2 with m = 0.2 A: v = sqrt(2 * 0.2 g / (rho C_D))."""
    air = FaceWind((0.0, 0.0, 0.0), air=1.2, drag=1.2, lift=0.0)
    run = simulate(sheet(grid(2, 2)), 3.0, fps=30, wind=air)
    wanted = np.sqrt(2.0 * 0.2 * G / (1.2 * 1.2))
    assert np.allclose(run.velocities[-1, :, 2], -wanted, rtol=1e-6)
    assert np.diff(run.energies).max() <= 0.0


def test_weak_wind_leaves_a_sheet_that_sticks_strong_wind_takes_it() -> None:
    """Along the sheet there is no drag; a wind from above at 45 degrees presses and pushes it."""
    floor = Plane((0.0, 0.0, 1.0), 0.0, friction=0.4)
    result = sheet(grid(3, 3, 0.05, 0.05), (floor,))
    weak = simulate(result, 0.5, wind=FaceWind((1.0, 0.0, -1.0), lift=0.0))
    assert weak.drift.max() <= 1e-13
    strong = simulate(result, 0.5, wind=FaceWind((12.0, 0.0, -3.0), lift=0.0))
    assert strong.drift.max() >= 0.1


def test_gusts_repeat_with_the_seed() -> None:
    one, same, other = (FaceWind((2.0, 0.0, 0.0), gust=0.5, seed=s) for s in (3, 3, 4))
    times = np.linspace(0.0, 200.0, 4001)
    speeds = np.array([one.at(t)[0] for t in times])
    assert np.array_equal(speeds, [same.at(t)[0] for t in times])
    assert np.abs(speeds - [other.at(t)[0] for t in times]).max() > 0.1
    assert np.isclose(speeds.mean(), 2.0, rtol=0.05)
    assert np.isclose(speeds.std(), 1.0, rtol=0.1)
    rising = FaceWind((2.0, 0.0, 0.0), onset=1.0)
    assert rising.at(0.25)[0] == 0.5
    assert rising.at(3.0)[0] == 2.0


def test_mass_damping_slows_a_flight_as_implicit_euler_says() -> None:
    """v_k = v_0 / (1 + alpha h)^k, closed form of the scheme."""
    free = sheet(grid(2, 2), gravity=(0.0, 0.0, 0.0))
    run = simulate(free, 0.5, velocity=(1.0, 0.0, 0.0), damping=Damping(mass=2.0))
    k = np.arange(len(run.times))
    assert np.abs(run.velocities[:, :, 0] - (1.0 + 2.0 / 60.0) ** -k[:, None]).max() <= 1e-10


def test_stiffness_damping_takes_vibration_and_leaves_flight() -> None:
    free = sheet(grid(2, 2), gravity=(0.0, 0.0, 0.0), stretch=1.0)
    damping = Damping(stiffness=0.02)
    flight = simulate(free, 0.2, velocity=(1.0, 0.0, 0.0), damping=damping)
    assert np.abs(flight.velocities[-1] - [1.0, 0.0, 0.0]).max() <= 1e-9
    rng = np.random.default_rng(0)
    shaken = 0.1 * rng.standard_normal((9, 3))
    plain = simulate(free, 0.2, velocity=shaken, substeps=4)
    damped = simulate(free, 0.2, velocity=shaken, substeps=4, damping=damping)
    assert damped.energies[-1] < 0.9 * plain.energies[-1]
    assert np.diff(damped.energies).max() <= 1e-12


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"velocity": (np.nan, 0, 0)}, "wind velocity"),
        ({"velocity": (1, 0, 0), "gust": -1.0}, "wind gust"),
        ({"velocity": (1, 0, 0), "lift": 2.0}, "wind lift"),
        ({"velocity": (1, 0, 0), "period": 0.0}, "wind period"),
    ],
)
def test_bad_winds_are_refused(wrong: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        FaceWind(**wrong)  # type: ignore[arg-type]


def test_bad_damping_is_refused() -> None:
    with pytest.raises(ValueError, match="damping stiffness"):
        Damping(stiffness=-1.0)
