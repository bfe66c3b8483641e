"""Why masses come from the natural shape (Ly 2018, Sec. 4.2): two triangles, one of them fixed.

The free corner of a flat pair of triangles sags and stretches under its weight.  Inverting that pose
recovers the flat shape exactly, but only when the mass follows the natural area.
"""

from dataclasses import replace

import casadi as ca
import numpy as np

from casashell import Energy, Problem, TriMesh, solve
from casashell.engine.assembly import Assembly
from formulations import discrete_shell

flat = TriMesh(
    [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.9, 0.5, 0.0], [0.9, 0.5, 0.0]], [[0, 1, 2], [1, 0, 3]]
)
fixed, free = [0, 1, 2], 3
shell = discrete_shell(flat, density=1.0, stretch=30.0, bend=0.5)

# Forward: Newton on the pose of the free corner, natural shape flat.
assembly, pose = Assembly(shell, 4), flat.vertices.copy()
own = slice(3 * free, 3 * free + 3)
for _ in range(50):
    force, entries = assembly.hessian(pose, flat.vertices)
    stiffness = assembly.pattern.matrix(entries).toarray()[own, own]
    move = np.linalg.solve(stiffness, -force[free])
    pose[free] += move * min(1.0, 0.1 / np.linalg.norm(move))
print(f"the corner sags by {-pose[free, 2]:.4f} m; residual {np.abs(force[free]).max():.1e} N")

# Backward, with masses of the natural shape.
target = flat.moved(pose)
shell = discrete_shell(target, density=1.0, stretch=30.0, bend=0.5)
found = solve(Problem(target, shell, pinned=fixed))
error = np.abs(found.rest - flat.vertices).max()
print(f"natural masses: flat shape recovered to {error:.1e} m")


def frozen(term: Energy) -> Energy:
    """The weight with every mass as it is in the target."""
    x, r, p = ca.SX.sym("x", 3, 3), ca.SX.sym("r", 3, 3), ca.SX.sym("p", 3)
    weight = ca.Function("frozen_weight", [x, r, p], [-ca.dot(p, x[:, 0] + x[:, 1] + x[:, 2]) / 3])
    params = term.params * target.face_areas[:, None]
    return replace(term, density=weight, params=params, reference=None)


wrong = solve(Problem(target, (*shell[:2], frozen(shell[2])), pinned=fixed))
off = np.abs(wrong.rest - flat.vertices).max()
print(f"frozen masses: off by {off:.1e} m")

if error > 1e-9 or off < 1e-3:
    raise SystemExit("natural masses should recover the flat shape, frozen ones should not")
