"""Feasibility of the garments of the reference runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from plain_shell import PlainShell

from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.inverse.feasibility import Verdict, feasibility
from casashell.io.meshes import read_mesh
from casashell.problem import Problem

# folder: metres per unit, contact tolerance in that unit; from the table of reference runs.
GARMENTS = {
    "skirt_8panel_smpl": (1.0, 0.0045),
    "skirt_4panel_smpl": (1.0, 0.0039),
    "top_avatar": (0.1, 0.033),
    "hat_on_sphere": (0.1, 0.039),
    "sleeve_avatar": (0.1, 0.040),
    "long_skirt_makehuman": (0.1, 0.069),
    "shirt_avatar": (0.1, 0.085),
    "pants_avatar": (0.1, 0.049),
    "dress_avatar": (0.1, 0.048),
    "knit_cap_avatar": (0.1, 0.091),
    "brimmed_hat_avatar": (0.1, 0.057),
}


def _real(
    data: Path,
    name: str,
    unit: float,
    tolerance: float,
    friction: float = 0.5,
    bend: float = 1e-3,
) -> Problem:
    target = read_mesh(data / name / "shell.obj", unit=unit)
    body = MeshObstacle(read_mesh(data / name / "obstacle.obj", unit=unit), friction=friction)
    terms = PlainShell(target, bend=bend, gravity=(0.0, -9.81, 0.0)).terms()
    return Problem(target, terms, (body,), contact_tolerance=tolerance * unit)


def test_slope_of_real_data(shared_data: Path) -> None:
    """tan 42.2 degrees = 0.91; at friction 1 it holds if it is stiff enough for its 6 m."""
    (part,) = feasibility(_real(shared_data, "sheet_on_slope_576", 1.0, 0.01)).parts
    assert part.verdict is Verdict.INFEASIBLE
    assert part.mending is not None
    assert part.mending.friction == pytest.approx(0.91, abs=0.015)
    rough = _real(shared_data, "sheet_on_slope_576", 1.0, 0.01, friction=1.0, bend=1.0)
    assert feasibility(rough).verdict is Verdict.FEASIBLE


@pytest.mark.parametrize("name", ["skirt_8panel_smpl", "skirt_4panel_smpl", "knit_cap_avatar"])
def test_real_garments_are_feasible(shared_data: Path, name: str) -> None:
    found = feasibility(_real(shared_data, name, *GARMENTS[name]))
    assert found.verdict is Verdict.FEASIBLE, found.summary


@pytest.mark.slow
@pytest.mark.parametrize("name", GARMENTS)
def test_all_garments_are_feasible(shared_data: Path, name: str) -> None:
    found = feasibility(_real(shared_data, name, *GARMENTS[name]))
    assert found.verdict is Verdict.FEASIBLE, found.summary
