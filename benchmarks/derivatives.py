"""Throughput of derivative kernels: stencils a second on one core, compiled and interpreted."""

from __future__ import annotations

import numpy as np

from benchmarks.timing import Goal, best
from casashell.app.builtin import skirt
from casashell.engine.assembly import Assembly
from casashell.engine.kernels import get_kernel

KERNELS = ("energy", "gradient", "hessian", "mixed", "lagrangian")


def run() -> tuple[list[Goal], str]:
    """Measure on a skirt of 10 000 vertices; goals and a Markdown table."""
    problem = skirt(50, 200).problem
    x = problem.target.vertices
    r = x + 1e-4 * np.random.default_rng(0).standard_normal(x.shape)
    lines = ["| term | stencils | " + " | ".join(f"{k} [M/s]" for k in KERNELS) + " |"]
    lines.append("|" + "---|" * (2 + len(KERNELS)))
    goals = []
    for interpreted in (False, True):
        for term in problem.energies:
            cells = []
            for name in KERNELS:
                kernel = get_kernel(term.density, name, interpreted=interpreted)
                seconds = best(lambda k=kernel, t=term: k(x, r, t.params, t.stencils, x))
                rate = len(term.stencils) / seconds / 1e6
                cells.append(f"{rate:.3g}")
                if (term.name, name, interpreted) == ("bend", "hessian", False):
                    goals.append(Goal("hinge Hessians a second and core", rate, 1.0, "M/s", False))
            label = f"{term.name} ({'interpreted' if interpreted else 'compiled'})"
            lines.append(f"| {label} | {len(term.stencils)} | " + " | ".join(cells) + " |")
    assembly = Assembly(problem.energies, len(x))
    assembly.hessian(x, r)
    whole = best(lambda: assembly.hessian(x, r))
    lines.append("")
    lines.append(
        f"Assembled gradient and Hessian of all terms, {len(x)} vertices: {whole * 1e3:.0f} ms."
    )
    return goals, "\n".join(lines)
