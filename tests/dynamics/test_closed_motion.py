"""Motions with a closed form: free fall, inclines, braking, momentum, energy, a vibrating strip."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from meshes import grid, jittered, rolled
from posed import G, sheet, sheet_on_incline

from casashell.contact.obstacles import Plane
from casashell.dynamics.simulate import simulate
from casashell.dynamics.simulation import SimulationStatus


def test_free_fall_is_that_of_implicit_euler_exactly() -> None:
    """x_k = x_0 - g h^2 k (k + 1) / 2, closed form of the scheme."""
    run = simulate(sheet(grid(3, 3)), 0.25, fps=60)
    k = np.arange(16)
    fallen = -G / 60**2 * k * (k + 1) / 2
    wanted = run.positions[0][None] + fallen[:, None, None] * np.array([0.0, 0.0, 1.0])
    assert np.abs(run.positions - wanted).max() <= 1e-13
    assert np.abs(run.velocities[:, :, 2] + G / 60 * k[:, None]).max() <= 1e-11


def test_momentum_is_kept_without_forces_from_outside() -> None:
    """A strained sheet without gravity flies to pieces, its centre of mass stays."""
    mesh = grid(4, 4)
    still = sheet(mesh, gravity=(0.0, 0.0, 0.0))
    run = simulate(still, 0.2, rest=jittered(mesh, 0.01).vertices)
    assert run.status is SimulationStatus.COMPLETE
    assert run.speeds.max() > 0.1  # it does move
    areas = mesh.moved(jittered(mesh, 0.01).vertices).face_areas
    mass = np.bincount(mesh.faces.ravel(), np.repeat(0.2 * areas / 3.0, 3))
    momentum = np.einsum("v,fvi->fi", mass, run.velocities)
    assert np.abs(momentum).max() <= 1e-9 * mass.sum() * run.speeds.max()


@pytest.mark.parametrize("degrees", [15.0, 35.0])
def test_a_sheet_below_the_angle_of_friction_does_not_move_at_all(degrees: float) -> None:
    """tan(alpha) = mu (1 - 1e-3): exact stick has no creep."""
    friction = np.tan(np.radians(degrees)) / (1.0 - 1e-3)
    result, _ = sheet_on_incline(degrees, float(friction))
    run = simulate(result, 2.0)
    assert run.drift.max() <= 1e-13
    assert run.speeds.max() <= 1e-12
    assert run.contact.all()


@pytest.mark.parametrize(("degrees", "friction"), [(20.0, 0.3), (30.0, 0.5), (30.0, 0.0)])
def test_a_sheet_above_it_slides_as_newton_says(degrees: float, friction: float) -> None:
    """a = g (sin alpha - mu cos alpha), and v_k = k h a by implicit Euler exactly."""
    result, down = sheet_on_incline(degrees, friction)
    run = simulate(result, 0.5)
    angle = np.radians(degrees)
    a = G * (np.sin(angle) - friction * np.cos(angle))
    k = np.arange(len(run.times))
    assert np.abs(run.velocities @ down - a / 60 * k[:, None]).max() <= 1e-8
    across = run.positions - run.positions[0]
    across = across - (across @ down)[:, :, None] * down
    assert np.abs(across).max() <= 1e-9


def braking(fps: float) -> tuple[float, float]:
    """Distance to a stop on a plane of friction 0.4 after a start at 1 m/s, and the last speed.

    The start is a tilt of gravity: the sheet is let slide down 1 m/s worth of time, then brakes.
    """
    flat = grid(3, 3, 0.05, 0.05)
    floor = Plane((0.0, 0.0, 1.0), 0.0, friction=0.4)
    result = sheet(flat, (floor,))
    run = simulate(result, 0.5, fps=fps, velocity=np.array([1.0, 0.0, 0.0]))
    moved = run.positions[-1] - run.positions[0]
    assert np.ptp(moved[:, 0]) <= 1e-9
    return float(moved[0, 0]), float(run.speeds[-1])


def test_braking_distance_and_stay() -> None:
    """v^2 / (2 mu g), with an error of first order in the step."""
    wanted = 1.0 / (2.0 * 0.4 * G)
    errors = []
    for fps in (60.0, 120.0, 240.0):
        distance, speed = braking(fps)
        assert speed <= 1e-13
        errors.append(abs(distance - wanted))
    assert errors[2] <= 0.03 * wanted
    assert 1.5 <= errors[0] / errors[1] <= 2.6
    assert 1.5 <= errors[1] / errors[2] <= 2.6


def test_energy_never_grows_without_input() -> None:
    """A bent sheet that falls on a floor and comes to rest; the tolerance is 1e-9 of its weight."""
    bent = rolled(grid(6, 3, 0.05, 0.05), 0.05, 0.3)
    lifted = bent.moved(bent.vertices + np.array([0.0, 0.0, 0.05]))
    run = simulate(sheet(lifted, (Plane((0.0, 0.0, 1.0), 0.0, 0.5),)), 1.0)
    assert run.status is SimulationStatus.COMPLETE
    scale = np.abs(run.potential).max()
    assert np.diff(run.energies).max() <= 1e-9 * scale
    assert run.positions[:, :, 2].min() >= -1e-9
    assert run.contact[-1].any()
    assert run.residuals.max() <= 1e-6


def test_first_order_in_the_step() -> None:
    """The error of a swinging flap halves with the step."""
    flap = grid(4, 1, 0.05, 0.05)
    held = sheet(flap, pinned=(0, 1), bend=1e-2)
    ends = [simulate(held, 0.1, fps=20, substeps=n).positions[-1] for n in (8, 16, 32, 64)]
    errors = [np.abs(a - b).max() for a, b in itertools.pairwise(ends)]
    assert 1.7 <= errors[0] / errors[1] <= 2.3
    assert 1.8 <= errors[1] / errors[2] <= 2.2


def swing(fps: float) -> float:
    """Angular frequency [rad/s] of a strip clamped at one end, let go in its first mode."""
    cells, a = 16, 0.02
    strip = grid(cells, 1, a, a)
    # The first row of hinges bends the half cell on either side of it.
    length = (cells - 0.5) * a
    beta = 1.875104068711961 / length
    z = beta * np.maximum(strip.vertices[:, 0] - 0.5 * a, 0.0)
    ratio = 0.7340955137589125  # (cosh + cos) / (sinh + sin) at beta L
    mode = np.cosh(z) - np.cos(z) - ratio * (np.sinh(z) - np.sin(z))
    edge = strip.vertices[strip.hinges[:, 1]] - strip.vertices[strip.hinges[:, 0]]
    diagonal = (np.abs(edge[:, :2]) > 0.5 * a).all(axis=1)
    bend = np.where(diagonal, 0.1, 1e-3)  # stiff diagonals: bending does not turn into twist
    held = sheet(strip, gravity=(0.0, 0.0, 0.0), pinned=(0, 1, 2, 3), bend=bend, stretch=50.0)
    velocity = 1e-3 * mode[:, None] * np.array([0.0, 0.0, 1.0])
    tip = simulate(held, 0.9, fps=fps, velocity=velocity).positions[:, -2:, 2].mean(axis=1)
    k = int(np.flatnonzero((tip[1:-1] > 0.0) & (tip[2:] <= 0.0))[0]) + 1
    return float(np.pi * fps / (k + tip[k] / (tip[k] - tip[k + 1])))


def test_first_frequency_of_a_cantilever() -> None:
    """omega = sqrt(D / rho) 1.8751^2 / L^2; hinges across the strip have D = 3 k_theta in closed form.

    The scheme turns omega into atan(omega h) / h, so h^2 is extrapolated away.
    """
    coarse, fine = swing(60.0), swing(120.0)
    found = fine + (fine - coarse) / 3.0
    length = 15.5 * 0.02
    wanted = np.sqrt(3.0 * 1e-3 / 0.2) * (1.875104068711961 / length) ** 2
    assert abs(found / wanted - 1.0) <= 0.003  # lumped masses and 16 cells
    assert abs(coarse / wanted - 1.0) > abs(fine / wanted - 1.0)
