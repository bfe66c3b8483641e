"""Hard cases: each was once answered wrongly, most of them with a false proof."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from forward import settle
from meshes import cap, grid, joined, rolled
from plain_shell import PlainShell

from casashell.contact.detect import Contacts
from casashell.contact.obstacles import Plane, Sphere
from casashell.engine.assembly import Assembly
from casashell.engine.energy import Energy
from casashell.engine.sparse_solver import make_solver
from casashell.inverse import certificate as certificate_module
from casashell.inverse.advice import status_of
from casashell.inverse.certificate import certify, stiffness_matrix
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.result import Certificate
from casashell.solving import solve
from casashell.status import Status
from formulations import area_gravity, edge_stretch, hinge_bending, proximity

GOOD = Certificate(1e-10, 0.1, 0.2, 0.5, 3.0, 0.0, 0.01, 0.1)


@pytest.mark.parametrize(
    "entry",
    [
        "cone_margin",
        "min_normal_force",
        "min_eigenvalue",
        "min_eigenvalue_scaled",
        "target_distance",
    ],
)
def test_nan_in_a_certificate_is_never_solved(entry):
    assert not status_of(replace(GOOD, **{entry: float("nan")})).certified


def test_failed_eigenvalue_is_not_nothing_free(monkeypatch):
    monkeypatch.setattr(certificate_module, "lowest_eigenvalues", lambda m, k: np.array([-np.inf]))
    m = grid(3, 2)
    c, _ = certify(
        PlainShell(m, gravity=(0, 0, 0)).terms(),
        m.vertices,
        m.vertices,
        m.vertices,
        Contacts.empty(),
        np.zeros((0, 3)),
        np.array([0, 1, 11]),
        0.1,
    )
    assert not status_of(c).certified


def _mast(n, h, k, b, rho):
    flat = grid(n, n, h, h)
    m = flat.moved(flat.vertices[:, [0, 2, 1]])
    mid = (n // 2) * (n + 1)
    return Problem(m, PlainShell(m, rho, k, b).terms(), pinned=[mid, mid + n // 2, mid + n])


@pytest.mark.parametrize(
    "args", [(20, 0.02, 2000.0, 0.1, 0.2), (8, 0.01, 2e4, 1.0, 0.1), (6, 0.01, 2e4, 1.0, 0.1)]
)
def test_free_turn_is_never_certified(args):
    """Upright sheet held on a vertical line turns freely: neutral, whatever rounding says."""
    r = solve(_mast(*args))
    assert r.status is Status.UNSTABLE
    assert r.certificate.neutral_modes == 1


@pytest.mark.parametrize("pinned", [True, False])
def test_weight_without_stiffness_is_a_status_not_an_exception(pinned):
    m = grid(10, 10, 0.05, 0.05)
    v = m.vertices.copy()
    v[v[:, 0] > 0.26, 2] += 0.05
    m = m.moved(v)
    kw = (
        {"pinned": range(11)}
        if pinned
        else {"obstacles": (Plane((0, 0, 1), 0.0),), "contact_tolerance": 1e-3}
    )
    assert not solve(Problem(m, (area_gravity(m, 0.2),), **kw)).status.certified


def test_terms_without_measure():
    m = cap(3, 0.3, 1.2)
    E = tuple(replace(e, measure=None) for e in PlainShell(m, bend=1e-6).terms())
    solve(Problem(m, E, (Sphere((0, 0, 0.2), 0.1),), contact_tolerance=5e-3))


def _dead(n, f):
    x, r, p = ca.SX.sym("x", 3, 1), ca.SX.sym("r", 3, 1), ca.SX.sym("p", 3)
    return Energy(
        "pull", ca.Function("dead", [x, r, p], [-ca.dot(p, x)]), np.arange(n)[:, None], f, load=True
    )


def test_balanced_pull_is_not_infeasible():
    m = grid(4, 2)
    f = np.zeros((15, 3))
    f[:3, 0], f[-3:, 0] = -0.1, 0.1
    r = solve(Problem(m, (edge_stretch(m, 20.0), hinge_bending(m, 1e-2), _dead(15, f))))
    assert r.status is not Status.INFEASIBLE  # a natural shape exists: shorter by 3 %


def test_springs_that_hold_are_not_infeasible():
    """Corner springs hold a sheet; the target is the pose that settles from the flat natural shape."""
    m = grid(4, 2)
    w = area_gravity(m, 0.2)
    total = Assembly([w], 15).nodal_loads(m.vertices)[:, 2].sum()
    pull = np.zeros(15)
    pull[[0, 2, 12, 14]] = 50.0
    springs = proximity(m.moved(m.vertices + np.array([0, 0, -total / 200.0])), pull)
    terms = (edge_stretch(m, 20.0), hinge_bending(m, 1e-1), w, springs)
    x = settle(Assembly(terms, 15), m.vertices, m.vertices, np.ones(15, bool))
    c, _ = certify(
        terms,
        x,
        x,
        m.vertices,
        Contacts.empty(),
        np.zeros((0, 3)),
        np.zeros(0, int),
        m.mean_edge_length,
    )
    assert status_of(c) is Status.SOLVED  # the flat sheet IS a natural shape of this target
    assert solve(Problem(m.moved(x), terms)).status is not Status.INFEASIBLE


def test_f0_without_gravity_is_the_mean_reaction():
    """interface.md: mean of |f| on pinned and contact vertices without gravity."""
    m = grid(3, 2)
    terms = (edge_stretch(m, 20.0), hinge_bending(m, 1e-3))
    pins = np.array([0, 1, 2, 9, 10, 11])
    rest = m.vertices * 0.9
    c, f = certify(
        terms, m.vertices, m.vertices, rest, Contacts.empty(), np.zeros((0, 3)), pins, 0.1
    )
    assert c.f0 == pytest.approx(np.linalg.norm(f[pins], axis=1).mean())


def test_smooth_slope_advice_says_friction():
    a = np.radians(5.0)
    turn = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
    m = grid(3, 3)
    m = m.moved(m.vertices @ turn.T)
    r = solve(
        Problem(
            m,
            PlainShell(m).terms(),
            (Plane((-np.sin(a), 0.0, np.cos(a)), 0.0, friction=0.0),),
            contact_tolerance=1e-6,
        )
    )
    assert r.status is Status.INFEASIBLE
    assert "no friction is enough" not in r.advice


def test_a_single_energy_is_a_value_error():
    m = grid(2, 2)
    with pytest.raises(ValueError, match="energ"):
        Problem(m, PlainShell(m).terms()[0])


def test_independent_parts_do_not_share_force_scales():
    hat = cap(4, 0.2, 1.3)
    page = rolled(grid(5, 3, 0.05, 0.05), 0.05, 0.12)
    head = (Sphere((0.0, 0.0, 0.05), 0.15, friction=0.5),)
    both = joined(hat, page.moved(page.vertices + np.array([2.0, 0, 0])))
    together = solve(
        Problem(
            both,
            PlainShell(both, bend=3e-3).terms(),
            head,
            pinned=61 + np.arange(8),
            contact_tolerance=6e-3,
        )
    )
    alone = solve(Problem(hat, PlainShell(hat, bend=3e-3).terms(), head, contact_tolerance=6e-3))
    assert np.abs(together.rest[:61] - alone.rest).max() <= 1e-8 * hat.mean_edge_length


def test_same_name_twice_in_an_assembly():
    m = grid(2, 2)
    a, b = (
        edge_stretch(m, 1.0),
        replace(edge_stretch(m, 1.0), stencils=edge_stretch(m, 1.0).stencils[::-1]),
    )
    x = m.vertices * 1.1
    try:
        two = Assembly([a, b], 9)
    except ValueError:
        return
    one = Assembly([edge_stretch(m, 2.0)], 9)
    assert two.hessian(x, m.vertices)[1] == pytest.approx(one.hessian(x, m.vertices)[1])


@pytest.mark.parametrize("backend", ["mumps", "superlu", "pardiso"])
def test_rhs_of_wrong_length(backend):
    """MUMPS reads and writes outside the array otherwise."""
    if backend == "pardiso":
        pytest.importorskip("pypardiso")
    pattern = Assembly([edge_stretch(grid(2, 2), 1.0)], 9).pattern
    s = make_solver(pattern.indptr, pattern.indices, "general", backend)
    s.factor((pattern.rows == pattern.indices).astype(float))
    with pytest.raises(ValueError, match="right-hand side"):
        s.solve(np.ones(26))


def test_negative_stencil_is_named():
    m = grid(3, 2)
    bad = replace(edge_stretch(m, 1.0), stencils=-edge_stretch(m, 1.0).stencils)
    with pytest.raises(ValueError, match=r"vertex -11,"):
        Problem(m, (bad,))


def test_interrupt_during_the_certificate(monkeypatch):
    import sys

    module = sys.modules["casashell.solving"]

    def stop(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "certify", stop)
    m = grid(2, 2)
    try:
        r = solve(Problem(m, PlainShell(m).terms(), pinned=range(9)))
    except KeyboardInterrupt:
        pytest.fail("the interrupt came through")
    assert r.status is Status.INTERRUPTED


def test_unwritable_cache_leaves_no_litter(tmp_path, monkeypatch):
    import tempfile

    from casashell.engine import build_cache

    monkeypatch.setenv("CASASHELL_CACHE", "/dev/null/x")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for i in range(3):
        build_cache.build_library(f"k{i}", f"int a(void) {{ return {i}; }}\n")
    assert len(list(tmp_path.iterdir())) <= 1  # one folder a process, not one a kernel


@pytest.mark.parametrize("where", ["solver", "certificate"])
def test_without_inertia_the_lowest_eigenvalue_is_still_the_lowest(where, monkeypatch):
    """SuperLU knows no inertia: None must not be read as 'no negative eigenvalue'."""
    import scipy.sparse as sp

    from casashell.inverse.stability import lowest_eigenpairs

    monkeypatch.setenv("CASASHELL_LINEAR_SOLVER", "superlu")
    monkeypatch.setattr(
        certificate_module, "_SUPERLU_LIMIT", 0
    )  # as above 12 000 degrees of freedom
    rng = np.random.default_rng(1)
    half = sp.random_array((300, 300), density=0.02, rng=rng, data_sampler=rng.standard_normal)
    a = sp.csr_array(half + half.T + sp.diags_array(rng.uniform(-1.0, 8.0, 300)))
    found = (
        lowest_eigenpairs(a, 1)[0]
        if where == "solver"
        else certificate_module.lowest_eigenvalues(a, 1)
    )
    assert found[0] == pytest.approx(np.linalg.eigvalsh(a.toarray())[0], rel=1e-6)


def _arch(height: float) -> TriMesh:
    """Arch that stands on z = 0, with a triangle of smallest height ``height`` [m] cut into a face."""
    turn, y = (a.ravel() for a in np.mgrid[0 : np.pi : 21j, 0:0.05:6j])
    points = np.column_stack([-0.05 * np.cos(turn), y, 0.05 * np.sin(turn)])
    points[np.abs(points[:, 2]) < 1e-12, 2] = 0.0
    i = np.arange(21 * 6).reshape(21, 6)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    corners = faces[40]
    low, high, top = points[corners]
    point = 0.5 * (low + high)
    inwards = top - point
    new = point + height * inwards / np.linalg.norm(inwards)
    p, q, r = (int(v) for v in corners)
    n = len(points)
    kept = np.delete(faces, 40, axis=0)
    return TriMesh(np.vstack([points, new]), np.vstack([kept, [[p, q, n], [q, r, n], [r, p, n]]]))


@pytest.mark.parametrize("height", [1e-3, 1e-4, 3e-5])
def test_slivers_do_not_spoil_the_certificate(height):
    """Against exact derivatives: the certificate took one step length for all stencils once."""
    mesh = _arch(height)
    terms = PlainShell(mesh, density=0.5).terms()
    exact = Assembly(terms, len(mesh.vertices))
    rest = mesh.vertices * 1.001
    plain = stiffness_matrix(terms, mesh.vertices, rest, mesh.mean_edge_length).toarray()
    full = exact.pattern.matrix(exact.hessian(mesh.vertices, rest)[1]).toarray()
    assert np.abs(plain - full).max() <= 1e-7 * np.abs(full).max()
    lowest = np.linalg.eigvalsh(full)[:8]
    assert np.linalg.eigvalsh(plain)[:8] == pytest.approx(lowest, abs=1e-9 * np.abs(full).max())


def test_a_single_triangle_is_solved_or_says_why():
    mesh = TriMesh([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]])
    assert solve(Problem(mesh, PlainShell(mesh).terms(), pinned=[0, 1, 2])).status is Status.SOLVED
    assert not solve(Problem(mesh, PlainShell(mesh).terms(), pinned=[0, 1])).status.certified


def test_vanishing_weight_proves_nothing():
    mesh = _arch(2e-3)
    floor = (Plane((0, 0, 1), 0.0, friction=0.5),)
    for g in (0.0, 1e-160, 1e-300):
        terms = PlainShell(mesh, gravity=(0, 0, -g)).terms()
        found = solve(Problem(mesh, terms, floor, contact_tolerance=1e-6))
        assert found.status is not Status.INFEASIBLE
