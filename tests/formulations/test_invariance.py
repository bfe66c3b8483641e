"""Rest state, rigid motions and units: what a formulation must do whatever its formula."""

from __future__ import annotations

import numpy as np
import pytest
from catalogue import GRAVITY, NAMES, build, case
from meshes import grid, jittered, rigid_motion, rolled, rotation

from casashell.engine.assembly import Assembly
from casashell.mesh import TriMesh
from casashell.typing import FloatArray


def _total(name: str, mesh: TriMesh, x: FloatArray, gravity: FloatArray = GRAVITY) -> float:
    """Energy of the pose ``x`` of the natural shape ``mesh``."""
    return Assembly([build(name, mesh, gravity)], len(x)).energy(x, mesh.vertices)


@pytest.mark.parametrize("name", ["stretch", "bend", "proximity"])
def test_no_energy_and_no_force_at_rest(name: str) -> None:
    """Also for a natural shape that is moved rigidly; gravity has no rest state."""
    this = case(name)
    moved = this.r if name == "proximity" else rigid_motion(this.r, 7)
    force_scale = np.abs(this.run("gradient", this.x, this.r)[0]).max()
    assert np.abs(this.run("energy", moved, this.r)[0]).max() <= 1e-25
    assert np.abs(this.run("gradient", moved, this.r)[0]).max() <= 1e-12 * force_scale


@pytest.mark.parametrize("name", ["stretch", "bend", "gravity"])
def test_rigid_motion_of_the_natural_shape_changes_nothing(name: str) -> None:
    this = case(name)
    before = this.run("energy", this.x, this.r)[0]
    after = this.run("energy", this.x, rigid_motion(this.r, 5))[0]
    assert after == pytest.approx(before, rel=1e-11, abs=1e-13 * np.abs(before).max())


@pytest.mark.parametrize("name", ["stretch", "bend"])
def test_rigid_motion_of_the_pose_changes_nothing(name: str) -> None:
    this = case(name)
    before = this.run("energy", this.x, this.r)[0]
    after = this.run("energy", rigid_motion(this.x, 6), this.r)[0]
    assert after == pytest.approx(before, rel=1e-11, abs=1e-13 * np.abs(before).max())


def test_turned_world_has_the_same_weight() -> None:
    """Pose and gravity turned together."""
    this, turn = case("gravity"), rotation(8)
    natural = grid(3, 2).moved(this.r)
    before = _total("gravity", natural, this.x)
    assert _total("gravity", natural, this.x @ turn.T, turn @ GRAVITY) == pytest.approx(before)


def test_lifting_costs_weight_times_height() -> None:
    """Closed form: E(x + h) - E(x) = -m g . h."""
    mesh = jittered(grid(3, 2), 0.01, seed=3)
    density = np.linspace(0.1, 0.3, len(mesh.faces))
    rise = np.array([0.2, -0.4, 0.3])
    change = _total("gravity", mesh, mesh.vertices + rise) - _total("gravity", mesh, mesh.vertices)
    assert change == pytest.approx(-(density @ mesh.face_areas) * (GRAVITY @ rise), rel=1e-12)


def test_target_and_pose_moved_together_keep_their_springs() -> None:
    mesh, pose = grid(3, 2), case("proximity").x
    moved = mesh.moved(rigid_motion(mesh.vertices, 9))
    before = _total("proximity", mesh, pose)
    assert _total("proximity", moved, rigid_motion(pose, 9)) == pytest.approx(before, rel=1e-12)


# Powers of length in the energies at fixed k_L [N], k_theta [J], rho g [N/m2], lambda [N/m].
@pytest.mark.parametrize(
    ("name", "power"), [("stretch", 1), ("bend", 0), ("gravity", 3), ("proximity", 2)]
)
def test_energy_scales_with_its_power_of_length(name: str, power: int) -> None:
    mesh = jittered(rolled(grid(3, 2), 0.1, 0.4), 0.005, seed=1)
    pose = jittered(rolled(grid(3, 2), 0.1, 0.7), 0.005, seed=2).vertices
    one = _total(name, mesh, pose)
    for s in (1e-3, 10.0, 250.0):
        large = _total(name, mesh.moved(s * mesh.vertices), s * pose)
        assert large == pytest.approx(s**power * one, rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_energy_is_linear_in_its_material(name: str) -> None:
    mesh, pose = grid(3, 2), case(name).x
    energies = [
        Assembly([build(name, mesh, scale=s)], len(pose)).energy(pose, mesh.vertices)
        for s in (1.0, 3.0)
    ]
    assert energies[1] == pytest.approx(3.0 * energies[0], rel=1e-13)
