"""Newton, Gauss-Seidel sweeps and the conic fixed point on the same steps."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import grid, rolled
from posed import sheet

from casashell.contact.obstacles import Plane
from casashell.dynamics.coulomb import one_contact
from casashell.dynamics.newton import Solved, StepSolver
from casashell.dynamics.references import Method, solve_step
from casashell.dynamics.simulate import simulate
from casashell.dynamics.touch import Touches, contact_residual
from casashell.typing import FloatArray


@pytest.mark.parametrize("seed", range(40))
def test_one_contact_in_closed_form_obeys_the_law(seed: int) -> None:
    """Random W, b and friction: the force satisfies Coulomb's law to rounding."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((3, 3))
    w, b, mu = root @ root.T + 0.1 * np.eye(3), rng.standard_normal(3), float(rng.uniform(0, 1.5))
    f = one_contact(w, b, mu)
    u = w @ f + b
    assert f[0] >= 0.0
    assert u[0] >= -1e-9
    assert abs(f[0] * u[0]) <= 1e-9
    drag, slip = np.hypot(*f[1:]), np.hypot(*u[1:])
    assert drag <= mu * f[0] + 1e-9
    if f[0] > 0.0 and slip > 1e-7:
        assert np.allclose(f[1:], -mu * f[0] * u[1:] / slip, atol=1e-6)


def compared(monkeypatch: pytest.MonkeyPatch, method: Method) -> list[tuple[float, float, float]]:
    """Difference of displacements and forces at every step of a small mixed run, and the slip."""
    found: list[tuple[float, float, float]] = []
    newton = StepSolver.solve

    def both(
        self: StepSolver, touches: Touches, d: FloatArray, f: FloatArray, h: float, **kind: bool
    ) -> Solved:
        mine = newton(self, touches, d, f, h, **kind)
        if len(touches) and mine.converged:
            other = solve_step(self, touches, d, f, method)
            law = contact_residual(touches, other.f, other.d).max()
            assert law <= 1e-4 * self.weight  # what an interior point leaves
            size = np.abs(mine.d).max()
            slip = np.abs(touches.slips(mine.d)[(mine.f != 0.0).any(axis=1)]).max(initial=0.0)
            found.append(
                (
                    float(np.abs(mine.d - other.d).max() / size),
                    float(np.abs(mine.f - other.f).max() / self.weight),
                    float(slip),
                )
            )
        return mine

    monkeypatch.setattr(StepSolver, "solve", both)
    mesh = rolled(grid(3, 1, 0.05, 0.05), 0.05, 0.4)
    low = float(mesh.vertices[:, 2].min())
    mesh = mesh.moved(mesh.vertices - [0.0, 0.0, low - 1e-3])
    floor = Plane((0.1, 0.0, 1.0), 0.0, friction=0.3)
    simulate(sheet(mesh, (floor,)), 0.1, velocity=(0.2, 0.0, 0.0))
    return found


@pytest.mark.parametrize("method", ["sweeps", "conic"])
def test_the_references_find_the_same_steps(
    monkeypatch: pytest.MonkeyPatch, method: Method
) -> None:
    found = np.array(compared(monkeypatch, method))
    assert len(found) >= 5
    assert found[:, 2].max() > 1e-5  # something slides
    assert found[:, 0].max() <= 1e-4
    assert found[:, 1].max() <= 1e-3
