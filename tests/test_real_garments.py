"""Reference runs on real garments: status, thresholds and the number of contacts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plain_shell import PlainShell

from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.inverse.forces import is_obstruction, rigid_obstruction
from casashell.inverse.piece import split
from casashell.io.meshes import read_mesh
from casashell.problem import Problem
from casashell.solving import solve
from casashell.status import Status

# folder: metres per unit, contact tolerance in that unit, contacts; from the table of reference runs.
RUNS = {
    "skirt_8panel_smpl": (1.0, 0.0045, 41),
    "skirt_4panel_smpl": (1.0, 0.0039, 39),
    "top_avatar": (0.1, 0.033, 105),
    "hat_on_sphere": (0.1, 0.039, 62),
    "sleeve_avatar": (0.1, 0.040, 38),
    "long_skirt_makehuman": (0.1, 0.069, 79),
    "shirt_avatar": (0.1, 0.085, 161),
    "pants_avatar": (0.1, 0.049, 221),
    "dress_avatar": (0.1, 0.048, 171),
    "knit_cap_avatar": (0.1, 0.091, 29),
}
FAST = ("skirt_8panel_smpl", "skirt_4panel_smpl", "top_avatar", "hat_on_sphere")


def _problem(
    folder: Path, unit: float, tolerance: float, friction: float = 0.5, bend: float = 1e-3
) -> Problem:
    target = read_mesh(folder / "shell.obj", unit=unit)
    body = MeshObstacle(read_mesh(folder / "obstacle.obj", unit=unit), friction=friction)
    shell = PlainShell(target, bend=bend, gravity=(0.0, -9.81, 0.0))
    return Problem(target, shell.terms(), (body,), contact_tolerance=tolerance * unit)


def _certified(shared_data: Path, name: str) -> None:
    unit, tolerance, contacts = RUNS[name]
    result = solve(_problem(shared_data / name, unit, tolerance))
    c = result.certificate
    assert len(result.contacts) == contacts
    assert result.status is Status.SOLVED, result.advice
    assert c.free_force is not None
    assert c.free_force <= 1e-6
    assert c.cone_margin is not None
    assert c.min_normal_force is not None
    assert min(c.cone_margin, c.min_normal_force) >= 0.0
    assert c.min_eigenvalue is not None
    assert c.min_eigenvalue > 0.0
    assert c.target_distance == 0.0
    assert np.all(np.isfinite(result.rest))


@pytest.mark.parametrize("name", FAST)
def test_fast_reference_runs_are_certified(shared_data: Path, name: str) -> None:
    _certified(shared_data, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in RUNS if name not in FAST])
def test_reference_runs_are_certified(shared_data: Path, name: str) -> None:
    _certified(shared_data, name)


def test_sheet_on_a_slope_of_42_degrees_is_proved_to_slide(shared_data: Path) -> None:
    """tan 42.2 degrees = 0.91: no natural shape at 0.5; the proof is checked again in plain terms."""
    problem = _problem(shared_data / "sheet_on_slope_576", 1.0, 0.01)
    assert len(problem.contacts) == 549
    result = solve(problem)
    assert result.status is Status.INFEASIBLE
    assert result.status.exit_code == 3
    (piece,) = split(problem)
    motion = rigid_obstruction(piece)
    assert motion is not None
    assert is_obstruction(piece, motion)
    z, n = motion[piece.contacts.vertices], piece.contacts.normals
    normal = (z * n).sum(axis=1)
    slip = np.linalg.norm(z - normal[:, None] * n, axis=1)
    assert np.all(normal - 0.5 * slip > 0.0)  # every force in its cone works along with it
    assert np.all(motion[:, 1] < 0.0)  # and every vertex falls


def test_rough_slope_holds_a_stiff_sheet(shared_data: Path) -> None:
    """Six metres wide, 27 vertices off the slope: it takes 1 J to carry those between the others."""
    problem = _problem(shared_data / "sheet_on_slope_576", 1.0, 0.01, friction=1.0, bend=1.0)
    assert solve(problem).status is Status.SOLVED
