"""Bodies in motion: carrying, turning, striking; and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import cap, grid
from posed import G, sheet
from small_scenes import hat_on_ball

import casashell
from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.obstacles import Plane, Sphere
from casashell.dynamics.bodies import DeformingBody, RigidBody
from casashell.dynamics.motion import MeshSequence, RigidMotion
from casashell.dynamics.simulate import simulate
from casashell.dynamics.simulation import SimulationStatus
from casashell.dynamics.stepper import Stepper
from casashell.mesh import TriMesh


def box(size: float = 1.0, height: float = 0.2) -> TriMesh:
    """A closed box with its top at z = 0."""
    corners = np.array(
        [[x, y, z] for z in (-height, 0.0) for y in (-size, size) for x in (-size, size)]
    )
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return TriMesh(corners, np.array(faces))


def table(friction: float) -> Plane:
    return Plane((0.0, 0.0, 1.0), 0.0, friction=friction, name="table")


def test_a_turntable_carries_a_sheet_that_sticks() -> None:
    """omega^2 r < mu g: the sheet turns as a rigid body with the table."""
    result = sheet(grid(3, 3, 0.05, 0.05), (table(0.9),), stretch=200.0)
    turning = RigidMotion(np.array([0.0, 1.0]), rotation=[[0, 0, 0], [0, 0, 0.5]])
    run = simulate(result, 1.0, motion={"table": turning})
    assert run.status is SimulationStatus.COMPLETE
    turn, shift = turning.at(1.0)
    wanted = run.positions[0] @ turn.T + shift
    assert np.abs(run.positions[-1] - wanted).max() <= 1e-10
    assert run.contact.all()


def test_a_table_that_is_pulled_away_slides_under_the_sheet() -> None:
    """Friction 0.2 accelerates the sheet by at most mu g while the table goes faster."""
    result = sheet(grid(3, 3, 0.05, 0.05), (table(0.2),))
    pulled = RigidMotion(np.array([0.0, 1.0]), translation=[[0, 0, 0], [4.0, 0, 0]])
    run = simulate(result, 0.5, motion=pulled)
    k = np.arange(len(run.times))
    assert np.abs(run.velocities[:, :, 0] - 0.2 * G / 60 * k[:, None]).max() <= 1e-8


def test_a_lift_pushes_and_lets_go() -> None:
    """A floor that rises carries the sheet; dropped faster than g it leaves the sheet behind."""
    result = sheet(grid(2, 2, 0.05, 0.05), (table(0.5),))
    lift = RigidMotion(np.array([0.0, 0.5, 0.6]), translation=[[0, 0, 0], [0, 0, 0.3], [0, 0, -2]])
    run = simulate(result, 0.6, motion=lift)
    level = np.array([lift.at(t)[1][2] for t in run.times])
    above = run.positions[:, :, 2] - level[:, None]
    assert above.min() >= -1e-9
    assert np.abs(above[:25]).max() <= 1e-9
    assert not run.contact[-1].any()
    assert above[-1].min() > 0.5


@pytest.mark.parametrize("speed", [5.0, 30.0])
def test_a_fast_ball_does_not_tunnel(speed: float) -> None:
    """A ball that would cross the sheet within a frame takes it along instead."""
    mesh = grid(6, 6, 0.06, 0.06)
    centred = mesh.moved(mesh.vertices - [0.18, 0.18, 0.0])
    ball = Sphere((0.0, 0.0, -0.2), 0.1, friction=0.5)
    result = sheet(centred, (ball,), gravity=(0.0, 0.0, 0.0), stretch=200.0)
    way = RigidMotion(np.array([0.0, 1.0]), translation=[[0, 0, 0], [0, 0, speed]])
    run = simulate(result, 4.0 / 60.0, motion=way)
    assert run.status is SimulationStatus.COMPLETE
    centre = -0.2 + speed * run.times
    away = np.linalg.norm(
        run.positions - np.stack([0 * centre, 0 * centre, centre], 1)[:, None], axis=2
    )
    assert away.min() >= 0.1 - 0.05 * 0.06  # no deeper than the slack of the check
    middle = 24  # the vertex that the ball meets head on
    assert run.positions[-1, middle, 2] >= centre[-1] + 0.097
    assert run.steps.max() > 1 or speed < 10.0


def test_a_thrown_sheet_does_not_pass_a_thin_wall() -> None:
    """A wall of 2 mm, and 0.5 m of motion a frame."""
    mesh = grid(3, 3, 0.05, 0.05)
    wall = MeshObstacle(box(1.0, 0.002), friction=0.3)
    lifted = mesh.moved(mesh.vertices + np.array([0.0, 0.0, 0.3]))
    result = sheet(lifted, (wall,))
    run = simulate(result, 0.1, velocity=(0.0, 0.0, -30.0))
    assert run.status is SimulationStatus.COMPLETE
    assert run.positions[:, :, 2].min() >= -1e-6
    assert run.contact[-1].any()


def test_a_sequence_of_a_rigid_motion_is_that_motion() -> None:
    """The same turn as keyframes and as a fine sequence of meshes."""
    ground = box()
    turning = RigidMotion(np.array([0.0, 0.5]), rotation=[[0, 0, 0], [0, 0, 0.3]])
    times = np.linspace(0.0, 0.5, 31)
    poses = [turning.at(t) for t in times]
    frames = np.array([ground.vertices @ turn.T + shift for turn, shift in poses])
    result = sheet(grid(2, 2, 0.05, 0.05), (MeshObstacle(ground, friction=0.8),))
    rigid = simulate(result, 0.5, motion=turning)
    sequence = simulate(result, 0.5, motion=MeshSequence(frames, times, ground.faces))
    assert np.abs(rigid.positions[-1] - rigid.positions[0]).max() > 0.01
    assert np.abs(rigid.positions - sequence.positions).max() <= 1e-9


def test_points_are_carried_with_the_surface() -> None:
    """A deforming body that moves rigidly carries points off the surface as a rigid body does."""
    ball = MeshObstacle(cap(4, 0.2, 1.2))
    motion = RigidMotion(
        np.array([0.0, 1.0]), [[0, 0, 0], [0.1, 0.2, 0.3]], [[0, 0, 0], [0.3, 1, 0]]
    )
    rigid = RigidBody(ball, 0, motion.at)
    points = np.asarray(ball.mesh.vertices)
    soft = DeformingBody(ball, 0, lambda t: points @ motion.at(t)[0].T + motion.at(t)[1])
    x = 1.05 * points + 0.003
    assert np.abs(rigid.carry(x, 0.2, 0.7) - soft.carry(x, 0.2, 0.7)).max() <= 1e-12
    assert rigid.carry(x, 0.2, 0.2) is x


NAN = float("nan")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: RigidMotion([0, 1], [[0, 0, 0], [NAN, 0, 0]]), "keyframe 1"),
        (lambda: RigidMotion([0, 1], [[0, 0, 0]]), "1 keyframes"),
        (lambda: RigidMotion([0, 2, 1]), "keyframe 2"),
        (lambda: RigidMotion([0, NAN]), "keyframe 1"),
        (lambda: MeshSequence(np.zeros((2, 4, 3)), [0.0]), "2 frames and 1 times"),
        (lambda: MeshSequence(np.full((2, 4, 3), NAN), [0, 1]), "frame 0: vertex 0"),
        (lambda: MeshSequence(np.zeros((2, 4)), [0, 1]), "shape"),
        (lambda: MeshSequence.at_rate(np.zeros((2, 4, 3)), 0.0), "fps"),
    ],
)
def test_bad_motions_are_refused(make: object, words: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=words):
        make()


def test_motions_that_do_not_suit_the_scene_are_refused() -> None:
    ground = box()
    result = sheet(grid(2, 2, 0.05, 0.05), (MeshObstacle(ground, name="box"), table(0.5)))
    frames = np.repeat(ground.vertices[None], 3, axis=0)
    short = MeshSequence.at_rate(frames, 60.0)
    for motion, words in (
        ({"ball": short}, "names obstacle 'ball'"),
        ({7: short}, "names obstacle 7"),
        ({1: short}, "moves a mesh"),
        ({"box": short}, "covers 0 .. 0.0333"),
        ({"box": MeshSequence.at_rate(frames[:, :-1], 1.0)}, "has 7 vertices, box has 8"),
        ({"box": MeshSequence.at_rate(frames + 1.0, 1.0)}, "must start from the scene"),
        ({"box": MeshSequence.at_rate(frames, 1.0, ground.faces[::-1])}, "other faces"),
        ({"box": "left"}, "bind"),
    ):
        with pytest.raises(ValueError, match=words):
            simulate(result, 0.5, motion=motion)  # type: ignore[arg-type]


def test_a_first_guess_follows_a_body_that_starts_to_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """The motion is the same without, but takes more iterations."""
    result = casashell.solve(hat_on_ball())
    turning = RigidMotion(np.array([0.0, 1.0]), rotation=[[0.0, 0.0, 0.0], [0.0, 0.0, 0.5]])
    run = simulate(result, 0.1, motion=turning)
    monkeypatch.setattr(Stepper, "_changes", lambda self, state, h: [])
    other = simulate(result, 0.1, motion=turning)
    assert run.status is SimulationStatus.COMPLETE
    assert run.iterations < other.iterations
    assert run.positions == pytest.approx(other.positions, abs=1e-9)
