"""Plug in a term of your own: a steady wind that presses on every face.

A term is a CasADi expression of one stencil, pose x (3,k), natural shape r (3,k), parameters p (m).
Derivatives, compiled kernels and sparse assembly follow from it; nothing has to be registered.
"""

import casadi as ca
import numpy as np

from casashell import Energy, Problem, TriMesh, solve
from formulations import discrete_shell


def steady_push(mesh: TriMesh, pressure: tuple[float, float, float]) -> Energy:
    """Dead load of ``pressure`` [N/m2] per natural area: E = -A(r)/3 p.(x1 + x2 + x3)."""
    x, r, p = ca.SX.sym("x", 3, 3), ca.SX.sym("r", 3, 3), ca.SX.sym("p", 3)
    area = ca.norm_2(ca.cross(r[:, 1] - r[:, 0], r[:, 2] - r[:, 0])) / 2
    energy = -area / 3 * ca.dot(p, x[:, 0] + x[:, 1] + x[:, 2])
    return Energy(
        name="wind",
        density=ca.Function("steady_push", [x, r, p], [energy]),
        stencils=mesh.faces,
        params=np.tile(pressure, (len(mesh.faces), 1)),
        load=True,  # an external load: the load path scales it like gravity
    )


# A banner of 0.4 m x 0.3 m hanging from its upper edge; z is up.
n, m = 13, 10
s, t = (a.ravel() for a in np.meshgrid(np.linspace(0, 0.4, n), np.linspace(0, -0.3, m)))
target_points = np.column_stack([s, 0.02 * np.sin(6 * s), t])
corner = np.arange(n * m).reshape(m, n)
a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
faces = np.concatenate([np.stack(q, axis=-1).reshape(-1, 3) for q in ((a, c, b), (b, c, d))])
banner = TriMesh(target_points, faces)

shell = discrete_shell(banner, density=0.2, stretch=20.0, bend=1e-3)
calm = solve(Problem(banner, shell, pinned=range(n))).require()
windy = solve(
    Problem(banner, (*shell, steady_push(banner, (0, 0.4, 0))), pinned=range(n))
).require()

moved = np.linalg.norm(windy.rest - calm.rest, axis=1).max()
print(f"the same pose, held against the wind: natural shapes differ by {1e3 * moved:.1f} mm")
print(
    f"certificate by {windy.certificate.evaluator}: free force {windy.certificate.free_force:.0e}"
)

if not (windy.status.certified and moved > 1e-3):
    raise SystemExit("the wind should change the natural shape of a stable pose")
