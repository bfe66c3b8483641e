"""Error of a heavy cantilever's tip against time: two kinds of creases, and a shell of triangles.

theta'' = -q (1 - s) cos theta, q = rho g L^3 / D = 23.2533: the tip is at (0.404640, -0.848116) L, by
scipy's solve_bvp to 1e-10.  Strip 1 x 0.1.  The shell is the one of Ly 2018 on right-angled triangles, with
k_theta = D / 3, which bends to cylinders as the plate does, and edges 100 D / W^2 stiff: with stiffer ones
its drape does not converge from flat.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks import ribbon_fem as fem
from casashell import Problem
from casashell.inverse.drape import drape
from casashell.inverse.piece import split
from casashell.inverse.pulled import Pulled
from casashell.ribbon import Ribbon, Setting, equilibrium
from casashell.typing import FloatArray
from formulations import discrete_shell, ribbon_physics

Q, TIP, WIDTH, GRAVITY = 23.2533, np.array([0.404640, -0.848116]), 0.1, 10.0
SEGMENTS, COLUMNS = (10, 20, 40, 80, 160), (10, 20, 40, 80)
STRETCH = 100.0 / WIDTH**2  # [N]


def ribbon_tip(
    segments: int, clamp_crease: bool, method: str = "exact"
) -> tuple[FloatArray, float]:
    """Tip (x, z) of the equilibrium from flat, and its seconds."""
    density = Q / GRAVITY
    strip = Ribbon(1.0, WIDTH, segments, 1.0, density, clamp_crease=clamp_crease, regulariser=1e-6)
    found = equilibrium(
        strip,
        ribbon_physics(),
        Setting(gravity=(0.0, 0.0, -GRAVITY)),
        method="augmented" if method == "augmented" else "exact",
    )
    return found.strip().middle[-1, [0, 2]], found.seconds


def shell_tip(columns: int) -> tuple[FloatArray, float, int]:
    """Tip (x, z) of the shell draped from flat, seconds and triangles."""
    rows = max(1, round(columns * WIDTH))
    patch = fem.strip(1.0, WIDTH, columns, rows, 1.0, Q / GRAVITY, begin=fem.still)
    material = discrete_shell(
        patch.mesh,
        density=Q / GRAVITY,
        stretch=STRETCH,
        bend=1.0 / 3.0 * patch.hinge_share,
        gravity=(0.0, 0.0, -GRAVITY),
    )
    problem = Problem(patch.mesh, material, pinned=np.flatnonzero(patch.owner >= 0))
    (piece,) = split(problem)
    flat = np.array(patch.mesh.vertices)
    begin = time.perf_counter()
    found = drape(Pulled(piece, 0.0), piece.target, flat - piece.origin, piece.held)
    took = time.perf_counter() - begin
    if not found.converged:
        raise RuntimeError(f"the shell with {columns} columns: no equilibrium")
    end = np.isclose(flat[:, 0], flat[:, 0].max())
    return (found.pose + piece.origin)[end].mean(axis=0)[[0, 2]], took, len(patch.mesh.faces)


def accuracy(kernel: float) -> list[str]:
    """Lines of a table."""
    lines = ["| strip | unknowns | error of the tip / L | s | / kernel |", "|---|---|---|---|---|"]
    ribbon_tip(SEGMENTS[0], True)  # functions are built once
    for name, crease, method in (
        ("ribbon, creases of the paper", False, "exact"),
        ("ribbon, clamp crease", True, "exact"),
        ("ribbon, clamp crease, augmented", True, "augmented"),
    ):
        for n in SEGMENTS:
            tip, took = ribbon_tip(n, crease, method)
            lines.append(_line(f"{name}, {n} segments", 2 * (n - 1) + crease, tip, took, kernel))
    for n in COLUMNS:
        tip, took, faces = shell_tip(n)
        vertices = (n + 1) * (max(1, round(n * WIDTH)) + 1)
        lines.append(_line(f"shell, {faces} triangles", 3 * vertices, tip, took, kernel))
    return lines


def _line(name: str, unknowns: int, tip: FloatArray, took: float, kernel: float) -> str:
    error = float(np.linalg.norm(tip - TIP))
    line = f"| {name} | {unknowns} | {error:.2e} | {took:.3f} | {took / kernel:.1f} |"
    print(line, flush=True)
    return line
