"""Assembly against counting, dense sums over stencils and the mechanics of a shell."""

from __future__ import annotations

from itertools import combinations

import casadi as ca
import numpy as np
import pytest
from catalogue import GRAVITY, NAMES, build
from meshes import grid, jittered, rolled

from casashell.engine.assembly import Assembly
from casashell.engine.energy import Energy
from casashell.inverse.piece import rigid_modes
from casashell.mesh import TriMesh
from casashell.typing import AnyArray, FloatArray
from formulations import area_gravity, discrete_shell, edge_stretch, hinge_bending, proximity

NX, NY = 4, 3
FLAT = grid(NX, NY)
REST = jittered(rolled(FLAT, 0.1, 0.3), 0.004, seed=1)
POSE = jittered(rolled(FLAT, 0.1, 0.6), 0.004, seed=2).vertices
COUNT = len(POSE)


def _shell(mesh: TriMesh = REST) -> tuple[Energy, ...]:
    return discrete_shell(mesh, density=0.2, stretch=20.0, bend=1e-3, gravity=GRAVITY)


def _dense(terms: tuple[Energy, ...], of: str) -> FloatArray:
    """d2E/dx2 or d2E/dx dr (3V,3V) by CasADi's virtual machine and a loop over stencils."""
    total = np.zeros((3 * COUNT, 3 * COUNT))
    for term in terms:
        k = term.size
        x, r, p = ca.SX.sym("x", 3, k), ca.SX.sym("r", 3, k), ca.SX.sym("p", term.params.shape[1])
        slope = ca.gradient(term.density(x, r, p), x)
        block = ca.jacobian(ca.vec(slope), x if of == "hessian" else r)
        function = ca.Function("block", [x, r, p], [ca.densify(block)])
        for ids, params in zip(term.stencils, term.params, strict=True):
            dofs = (3 * ids[:, None] + np.arange(3)).ravel()
            entries = function(POSE[ids].T, REST.vertices[ids].T, params)
            total[np.ix_(dofs, dofs)] += np.asarray(entries)
    return total


def test_non_zeros_of_a_grid() -> None:
    """9 (V + 2 E + 2 H): vertices, edges, and one new pair of opposite corners per hinge."""
    vertices = (NX + 1) * (NY + 1)
    edges = 3 * NX * NY + NX + NY
    hinges = edges - 2 * (NX + NY)
    pattern = Assembly(_shell(), COUNT).pattern
    assert pattern.nnz == 9 * (vertices + 2 * edges + 2 * hinges)
    without_bending = Assembly([edge_stretch(FLAT, 20.0)], COUNT).pattern
    assert without_bending.nnz == 9 * (vertices + 2 * edges)
    assert Assembly([proximity(FLAT, 1.0)], COUNT).pattern.nnz == 9 * vertices


def test_pattern_is_the_set_of_vertex_pairs_in_a_stencil() -> None:
    pairs = {(v, v) for v in range(COUNT)}
    for term in _shell():
        for stencil in term.stencils:
            pairs |= {(int(a), int(b)) for a, b in combinations(stencil, 2)}
            pairs |= {(int(b), int(a)) for a, b in combinations(stencil, 2)}
    pattern = Assembly(_shell(), COUNT).pattern
    stored = list(zip((pattern.rows // 3).tolist(), (pattern.indices // 3).tolist(), strict=True))
    assert set(stored) == pairs
    assert len(stored) == 9 * len(pairs)
    matrix = pattern.matrix(np.ones(pattern.nnz))
    assert matrix.has_canonical_format  # sorted columns, nothing twice


def test_lone_vertex_keeps_its_diagonal() -> None:
    """Nine entries for a vertex in no stencil, so that factorisations see a full diagonal."""
    pattern = Assembly([edge_stretch(FLAT, 20.0)], COUNT + 1).pattern
    assert np.count_nonzero(pattern.rows >= 3 * COUNT) == 9


@pytest.mark.parametrize("kernel", ["hessian", "mixed"])
def test_sparse_assembly_equals_dense_sum(kernel: str) -> None:
    terms = (*_shell(), build("proximity", FLAT))
    assembly = Assembly(terms, COUNT)
    gradient, entries = getattr(assembly, kernel)(POSE, REST.vertices)
    matrix = assembly.pattern.matrix(entries).toarray()
    wanted = _dense(terms, kernel)
    assert np.abs(matrix - wanted).max() <= 1e-12 * np.abs(wanted).max()
    alone = assembly.gradient(POSE, REST.vertices)
    assert gradient == pytest.approx(alone, rel=1e-13, abs=1e-15)


def test_lagrangian_is_the_change_of_the_mixed_block() -> None:
    """w.M(r + s) - w.M(r - s) = 2 A s + O(s^3), at two steps."""
    assembly, rng = Assembly(_shell(), COUNT), np.random.default_rng(5)
    w, s = rng.standard_normal((2, COUNT, 3))
    rest, errors = REST.vertices, []

    def pulled(r: FloatArray) -> FloatArray:
        matrix = assembly.pattern.matrix(assembly.mixed(POSE, r)[1])
        return np.asarray(matrix.T @ w.ravel())

    wanted = assembly.pattern.matrix(assembly.lagrangian(POSE, rest, w)) @ s.ravel()
    for step in (1e-3, 5e-4):
        slope = (pulled(rest + step * s) - pulled(rest - step * s)) / (2.0 * step)
        errors.append(np.abs(slope - wanted).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_gradient_is_the_slope_of_the_energy() -> None:
    assembly = Assembly(_shell(), COUNT)
    d = np.random.default_rng(6).standard_normal(POSE.shape)
    wanted, errors = float((assembly.gradient(POSE, REST.vertices) * d).sum()), []
    for step in (2e-3, 1e-3):
        ahead = assembly.energy(POSE + step * d, REST.vertices)
        behind = assembly.energy(POSE - step * d, REST.vertices)
        errors.append(abs((ahead - behind) / (2.0 * step) - wanted))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_hessian_is_symmetric_and_blind_to_rigid_motions_at_rest() -> None:
    elastic = [edge_stretch(REST, 20.0), hinge_bending(REST, 1e-3)]
    assembly = Assembly(elastic, COUNT)
    gradient, entries = assembly.hessian(REST.vertices, REST.vertices)
    matrix = assembly.pattern.matrix(entries).toarray()
    size = np.abs(matrix).max()
    assert np.abs(gradient).max() == 0.0
    assert np.abs(matrix - matrix.T).max() <= 1e-13 * size
    assert np.abs(matrix @ rigid_modes(REST.vertices)).max() <= 1e-12 * size
    values = np.linalg.eigvalsh(matrix)
    assert np.abs(values[:6]).max() <= 1e-12 * size
    assert values[6] >= 1e-6 * size  # and to nothing else


def test_turning_a_strained_shell_turns_its_forces() -> None:
    """H (a x x_i) = a x g_i away from rest: the derivative of g(R x) = R g(x)."""
    assembly = Assembly([edge_stretch(REST, 20.0), hinge_bending(REST, 1e-3)], COUNT)
    gradient, entries = assembly.hessian(POSE, REST.vertices)
    matrix = assembly.pattern.matrix(entries)
    for axis in np.eye(3):
        turned = matrix @ np.cross(axis, POSE).ravel()
        assert turned == pytest.approx(np.cross(axis, gradient).ravel(), rel=0, abs=1e-11)


def test_jacobian_at_rest_is_minus_the_stiffness() -> None:
    """Without load dE/dx(x, r) depends on x - r to first order at x = r."""
    assembly = Assembly(_shell(), COUNT)
    rest = REST.vertices
    hessian, mixed = assembly.hessian(rest, rest, 0.0)[1], assembly.mixed(rest, rest, 0.0)[1]
    assert np.abs(hessian + mixed).max() <= 1e-12 * np.abs(hessian).max()


def test_load_scales_the_weight_and_nothing_else() -> None:
    whole, rest = Assembly(_shell(), COUNT), REST.vertices
    none, full = whole.gradient(POSE, rest, 0.0), whole.gradient(POSE, rest)
    weight = Assembly([area_gravity(REST, 0.2, GRAVITY)], COUNT).gradient(POSE, rest)
    assert full - none == pytest.approx(weight, rel=1e-9, abs=1e-14)
    assert whole.gradient(POSE, rest, 0.25) == pytest.approx(none + 0.25 * weight, rel=1e-12)
    assert whole.energy(POSE, rest, 0.25) == pytest.approx(
        0.75 * whole.energy(POSE, rest, 0.0) + 0.25 * whole.energy(POSE, rest), rel=1e-12
    )
    mixed = [whole.mixed(POSE, rest, load)[1] for load in (0.0, 0.25, 1.0)]
    assert mixed[1] == pytest.approx(0.75 * mixed[0] + 0.25 * mixed[2], rel=1e-9, abs=1e-10)
    assert whole.nodal_loads(rest) == pytest.approx(-weight, rel=1e-12)


def test_idle_stencils_are_skipped() -> None:
    """Zero stiffness: not in the pattern, no kernel; the rest of the term is unchanged."""
    stiffness = np.full(len(REST.hinges), 1e-3)
    stiffness[::2] = 0.0
    some = Assembly([hinge_bending(REST, stiffness)], COUNT)
    assert len(some.energies[0].stencils) == np.count_nonzero(stiffness)
    idle = discrete_shell(REST, density=0.0, stretch=20.0, bend=0.0)
    assembly = Assembly(idle, COUNT)
    assert [term.name for term in assembly.energies] == ["stretch"]
    alone = Assembly([edge_stretch(REST, 20.0)], COUNT)
    assert assembly.pattern.nnz == alone.pattern.nnz
    assert np.array_equal(
        assembly.gradient(POSE, REST.vertices), alone.gradient(POSE, REST.vertices)
    )


def test_nothing_at_all_is_zero() -> None:
    assembly = Assembly([], 4)
    x = np.zeros((4, 3))
    assert assembly.energy(x, x) == 0.0
    assert np.all(assembly.gradient(x, x) == 0.0)
    assert np.all(assembly.hessian(x, x)[1] == 0.0)


@pytest.mark.parametrize("name", NAMES)
def test_interpreted_assembly_agrees(name: str) -> None:
    term = build(name, REST)
    compiled, interpreted = Assembly([term], COUNT), Assembly([term], COUNT, interpreted=True)
    assert not interpreted.compiled
    for kernel in ("hessian", "mixed"):
        one = getattr(compiled, kernel)(POSE, REST.vertices)
        other = getattr(interpreted, kernel)(POSE, REST.vertices)
        for a, b in zip(one, other, strict=True):
            assert np.abs(a - b).max() <= 1e-12 * max(np.abs(b).max(), 1e-3)


def test_wrong_number_of_positions_is_named() -> None:
    assembly = Assembly(_shell(), COUNT)
    with pytest.raises(ValueError, match=rf"positions must have shape \({COUNT}, 3\)"):
        assembly.gradient(POSE[:-1], REST.vertices)
    with pytest.raises(ValueError, match="positions must have shape"):
        assembly.hessian(POSE, REST.vertices.ravel())


def test_any_memory_layout_is_accepted() -> None:
    """Kernels read raw memory: slices, Fortran order and float32 have to be copied first."""
    assembly = Assembly(_shell(), COUNT)
    wanted = assembly.gradient(POSE, REST.vertices)
    wide = np.zeros((COUNT, 6))
    wide[:, ::2] = POSE
    for x in (np.asfortranarray(POSE), wide[:, ::2]):
        assert np.array_equal(assembly.gradient(x, REST.vertices), wanted)
    single: AnyArray = POSE.astype(np.float32)
    assert np.array_equal(
        assembly.gradient(single, REST.vertices),
        assembly.gradient(single.astype(np.float64), REST.vertices),
    )
