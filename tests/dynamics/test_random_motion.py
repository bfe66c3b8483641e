"""Random small scenes: soft and stiff, rough and smooth, fast bodies, wind; a few seeds that are fast."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import grid, rolled
from posed import sheet

from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.obstacles import Cone, Obstacle, Plane, Sphere
from casashell.dynamics.motion import RigidMotion
from casashell.dynamics.newton import Solved
from casashell.dynamics.sequence import solve_sequence
from casashell.dynamics.simulate import simulate
from casashell.dynamics.simulation import Simulation, SimulationStatus
from casashell.dynamics.stepper import State, Stepper, Tally
from casashell.dynamics.touch import Touches, natural_map
from casashell.mesh import TriMesh
from formulations.wind import FaceWind

EDGE = 0.05


def ground(kind: int, friction: float) -> Obstacle:
    """A plane, ball, cone or box whose highest point is near the origin."""
    if kind == 0:
        return Plane((0.2, 0.0, 1.0), 0.0, friction=friction)
    if kind == 1:
        return Sphere((0.0, 0.0, -0.3), 0.3, friction=friction)
    if kind == 2:
        return Cone((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.0, length=2.0, friction=friction)
    corners = [[x, y, z] for z in (-0.2, 0.0) for y in (-0.6, 0.6) for x in (-0.6, 0.6)]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return MeshObstacle(TriMesh(np.array(corners), np.array(faces)), friction=friction)


def scene(seed: int, monkeypatch: pytest.MonkeyPatch) -> tuple[Simulation, float, bool, Obstacle]:
    """A run, the largest violation of a friction cone in weights, whether energy came in."""
    rng = np.random.default_rng(seed)
    mesh = rolled(grid(4, 3, EDGE, EDGE), EDGE, float(rng.uniform(0.0, 0.3)))
    away = np.array([-0.1, -0.1, 0.02 - mesh.vertices[:, 2].min() + 0.1 * (seed % 4 == 0)])
    friction = float(rng.choice([0.0, 0.1, 0.5, 1.0, 2.0]))
    body = ground(seed % 4, friction)
    stiff = 10.0 ** rng.uniform(-3.0, 3.0, 2)
    result = sheet(
        mesh.moved(mesh.vertices + away), (body,), bend=1e-3 * stiff[0], stretch=20.0 * stiff[1]
    )
    shaken = RigidMotion(np.array([0.0, 0.2]), translation=[[0.0, 0.0, 0.0], [0.3, 0.0, 0.2]])
    fed = seed % 3 != 0
    motion = shaken if seed % 3 == 1 else None
    wind = FaceWind((4.0, 1.0, 0.0)) if seed % 3 == 2 else None
    worst = [0.0]
    accept = Stepper._accept

    def watched(
        self: Stepper,
        state: State,
        touches: Touches,
        solved: Solved,
        h: float,
        end: float,
        tally: Tally,
    ) -> None:
        push = (solved.f * touches.normal).sum(axis=1)
        drag = np.linalg.norm(solved.f - push[:, None] * touches.normal, axis=1)
        over = np.maximum(drag - touches.friction * push, -push)
        worst[0] = max(worst[0], float(over.max(initial=0.0)) / self.solver.weight)
        accept(self, state, touches, solved, h, end, tally)

    monkeypatch.setattr(Stepper, "_accept", watched)
    run = simulate(result, 0.25, motion=motion, wind=wind, velocity=(rng.uniform(-2, 2), 0.0, -1.0))
    return run, worst[0], fed, body


@pytest.mark.parametrize("seed", range(16))
def test_a_random_scene_obeys_the_laws(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    run, over, fed, body = scene(seed, monkeypatch)
    assert run.status is SimulationStatus.COMPLETE
    assert np.isfinite(run.positions).all()
    assert np.isfinite(run.velocities).all()
    assert over <= 1e-6
    assert run.residuals.max() <= 1e-6
    if not fed:
        rise = np.diff(run.energies).max(initial=0.0)
        assert rise <= 1e-6 * float(np.abs(run.energies).max())
    if seed % 3 != 1:
        for points in run.positions:
            assert body.signed_distance(points)[0].min() >= -0.06 * EDGE


def test_a_jammed_contact_is_solved_by_sweeps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where Newton's method is forbidden to solve, sweeps and the last polish give the same motion."""
    mesh = rolled(grid(3, 1, EDGE, EDGE), 0.05, 0.4)
    mesh = mesh.moved(mesh.vertices - [0.0, 0.0, float(mesh.vertices[:, 2].min()) - 1e-3])
    floor = Plane((0.1, 0.0, 1.0), 0.0, friction=0.3)
    falling = sheet(mesh, (floor,))
    usual = simulate(falling, 0.1, velocity=(0.2, 0.0, 0.0))
    seen: list[float] = []

    def by_sweeps(self: Stepper, touches: Touches, state: State, h: float) -> Solved:
        f = state.forces[touches.body, touches.vertex]
        made = solve_sequence(self.solver, touches, h * state.v, f, h)
        seen.append(float(np.abs(natural_map(touches, made.f, made.d).value).max(initial=0.0)))
        return made

    monkeypatch.setattr(Stepper, "_solve", by_sweeps)
    other = simulate(falling, 0.1, velocity=(0.2, 0.0, 0.0))
    assert len(seen) >= 6
    assert np.abs(other.positions - usual.positions).max() <= 1e-7


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_crumpled_sheet_lands(seed: int, friction: float) -> None:
    """Pressure within the sheet leaves vertices less than no stiffness; in the air nothing pushes them."""
    flat = grid(3, 2, EDGE, EDGE)
    flat = flat.moved(flat.vertices + np.array([0.0, 0.0, 0.01]))
    jitter = 1e-3 * np.random.default_rng(seed).normal(size=flat.vertices.shape)
    falling = sheet(
        flat.moved(flat.vertices + jitter), (Plane((0.0, 0.0, 1.0), 0.0, friction=friction),)
    )
    run = simulate(falling, 0.1, rest=flat.vertices)
    assert run.status is SimulationStatus.COMPLETE
    assert run.residuals.max() <= 1e-6
    assert run.steps.sum() <= 12
    assert run.contact[-1].any()
    assert run.positions[-1][:, 2].min() >= -1e-6
