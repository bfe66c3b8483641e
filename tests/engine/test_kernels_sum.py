"""Sums over stencils made in C and by the interpreter, against the blocks of the stencils."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.engine.assembly import Assembly
from casashell.engine.kernels import KERNELS, get_kernel
from casashell.mesh import TriMesh
from formulations import discrete_shell


def _strip() -> TriMesh:
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0), indexing="ij")
    k = np.arange(12).reshape(4, 3)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    points = np.stack([x.ravel(), y.ravel(), 0.1 * np.sin(x.ravel() + y.ravel())], axis=1)
    return TriMesh(0.1 * points, faces)


@pytest.mark.parametrize("interpreted", [False, True], ids=["compiled", "interpreted"])
@pytest.mark.parametrize("name", list(KERNELS))
def test_sum_is_the_sum_of_the_blocks(name: str, interpreted: bool) -> None:
    """`add` does what a loop over stencils with `+=` does, for every kernel of every term."""
    mesh = _strip()
    rng = np.random.default_rng(1)
    r = np.array(mesh.vertices)
    x, w = r + 0.01 * rng.normal(size=r.shape), rng.normal(size=r.shape)
    terms = discrete_shell(mesh, density=0.2, stretch=20.0, bend=1e-3)
    assembly = Assembly(terms, len(r))
    for term in assembly.energies:
        kernel = get_kernel(term.density, name, interpreted=interpreted)
        blocks = kernel(x, r, term.params, term.stencils, w)
        places = assembly.scatter_map(term)
        sizes = {1: 1, 3 * term.size: r.size}
        totals = tuple(np.ones(sizes.get(b.shape[1], assembly.pattern.nnz)) for b in blocks)
        kernel.add(x, r, term.params, term.stencils, w, 0.5, places, totals)
        for block, total in zip(blocks, totals):
            wanted = np.ones(len(total))
            for s, row in enumerate(block):
                where = {
                    1: np.zeros(1, dtype=np.int64),
                    3 * term.size: (3 * term.stencils[s][:, None] + np.arange(3)).ravel(),
                }.get(len(row), places[s])
                for i, value in zip(where, row):
                    wanted[i] += 0.5 * value
            assert total == pytest.approx(wanted, rel=1e-12, abs=1e-15)
