"""A sheet bent over a cylinder: find the natural shape that stays there, and read the proof."""

import numpy as np

from casashell import Cylinder, Problem, TriMesh, solve
from formulations import discrete_shell

# A sheet of 0.3 m x 0.2 m wrapped over a bar of radius 0.1 m; z is up.
radius, across, along = 0.1, 25, 13
arc = np.linspace(-0.15, 0.15, across) / radius
y = np.linspace(-0.1, 0.1, along)
angle, depth = (a.ravel() for a in np.meshgrid(arc, y, indexing="ij"))
vertices = np.column_stack([radius * np.sin(angle), depth, radius * np.cos(angle)])
# The two ends lift off the bar: this is what a designer drew, not what gravity would do.
lift = 0.05 * np.clip(np.abs(angle) - 0.9, 0.0, None) ** 2
vertices[:, [0, 2]] *= (1.0 + lift / radius)[:, None]

corner = np.arange(across * along).reshape(across, along)
a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[:-1, 1:], corner[1:, 1:]
faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, d), (a, d, c))])

target = TriMesh(vertices, faces)
cloth = discrete_shell(target, density=0.2, stretch=20.0, bend=1e-3)  # kg/m2, N, J
bar = Cylinder((0.0, -0.5, 0.0), (0.0, 1.0, 0.0), radius, length=1.0, friction=0.5)

result = solve(Problem(target, cloth, (bar,), contact_tolerance=1e-4))
result.require()  # raises when the target is not a certified equilibrium

proof = result.certificate
print(f"{result.status} in {result.seconds:.2f} s with {len(result.contacts)} contacts")
print(f"largest free force      {proof.free_force:.1e} of a nodal weight")
print(f"smallest cone margin    {proof.cone_margin:.1e} of a nodal weight")
print(f"lowest eigenvalue       {proof.min_eigenvalue:.3f} N/m")
print(f"natural shape: edges change by {100 * result.quality.max_stretch:.2f} % at most, ")
print(f"               angles by {np.degrees(result.quality.max_rest_fold):.1f} degrees at most")

if proof.free_force > 1e-6 or proof.cone_margin < 0.0 or proof.min_eigenvalue <= 0.0:
    raise SystemExit("the certificate does not hold")
