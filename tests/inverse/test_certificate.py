"""Every entry of a certificate against its definition, computed here by other means."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from meshes import cap, grid, jittered, rolled
from plain_shell import PlainShell

from casashell.contact.detect import Contacts
from casashell.engine.assembly import Assembly
from casashell.inverse.certificate import (
    certify,
    lowest_eigenvalues,
    scale_of_forces,
    stiffness_matrix,
    total_forces,
)
from casashell.mesh import TriMesh
from casashell.result import Certificate
from casashell.typing import FloatArray, IntArray
from formulations import hinge_bending

FLAT = grid(3, 2)
REST = jittered(rolled(FLAT, 0.1, 0.3), 0.004, seed=1).vertices
POSE = jittered(rolled(FLAT, 0.1, 0.5), 0.002, seed=2)
SHELL = PlainShell(POSE)
TERMS = SHELL.terms()
F0 = 0.2 * float(POSE.face_areas.sum()) * 9.81 / 12  # mean nodal weight of the target
PINS = np.array([0, 4], dtype=np.int64)


def _contacts(vertices: list[int], friction: list[float]) -> Contacts:
    normals = np.tile([0.0, 0.6, 0.8], (len(vertices), 1))
    count = len(vertices)
    ids = np.array(vertices, dtype=np.int64)
    return Contacts(ids, normals, np.array(friction), np.zeros(count), np.zeros(count, dtype=int))


def _certify(
    contacts: Contacts,
    forces: FloatArray,
    pinned: IntArray = PINS,
    pose: FloatArray = POSE.vertices,
) -> Certificate:
    h = POSE.mean_edge_length
    return certify(TERMS, POSE.vertices, pose, REST, contacts, forces, pinned, h)[0]


def test_forces_are_the_slope_of_the_energy() -> None:
    """Differences of 1e-6 m: their error is rounding, 1e-16 * E / 1e-6 m, some 1e-10 N."""
    plain = SHELL.forces(POSE.vertices, REST)
    assert total_forces(TERMS, POSE.vertices, REST) == pytest.approx(plain, rel=1e-6, abs=2e-9)
    assert np.abs(plain).max() > 0.1


def test_scale_is_the_mean_nodal_weight_of_the_target() -> None:
    assert scale_of_forces(TERMS, POSE.vertices) == pytest.approx(F0, rel=1e-12)
    weightless = PlainShell(POSE, density=0.0).terms()
    assert scale_of_forces(weightless, POSE.vertices) == 0.0


def test_free_force_is_the_largest_component_that_nothing_carries() -> None:
    contacts = _contacts([5, 7], [0.5, 0.5])
    forces = SHELL.forces(POSE.vertices, REST)
    found = _certify(contacts, forces[[5, 7]])
    free = np.setdiff1d(np.arange(12), [0, 4, 5, 7])
    assert found.free_force == pytest.approx(np.abs(forces[free]).max() / F0, rel=1e-6)
    assert found.f0 == pytest.approx(F0)
    assert found.h == POSE.mean_edge_length
    assert found.evaluator == "numpy"


def test_contact_forces_that_are_not_those_of_the_shell_count_as_free() -> None:
    """Claimed reactions are checked against dE/dx, they are not believed."""
    contacts = _contacts([5, 7], [0.5, 0.5])
    forces = SHELL.forces(POSE.vertices, REST)[[5, 7]]
    forces[1, 2] += 1e3 * F0
    assert _certify(contacts, forces).free_force == pytest.approx(1e3, rel=1e-2)


def test_cone_entries_are_the_worst_contact() -> None:
    """By hand for n = (0, 0.6, 0.8): f = a n + b t with t = (1, 0, 0) has f_N = a, |f_T| = |b|."""
    n, t = np.array([0.0, 0.6, 0.8]), np.array([1.0, 0.0, 0.0])
    forces = np.array([2.0 * n + 0.9 * t, 1.0 * n - 0.1 * t, 3.0 * n + 2.5 * t])
    found = _certify(_contacts([5, 6, 7], [0.5, 0.5, 1.0]), forces)
    assert found.cone_margin == pytest.approx(0.1 / F0, rel=1e-9)  # 0.1, 0.4, 0.5
    assert found.min_normal_force == pytest.approx(1.0 / F0, rel=1e-9)
    pulled = _certify(_contacts([5], [0.5]), -2.0 * n[None, :])
    assert pulled.min_normal_force == pytest.approx(-2.0 / F0, rel=1e-9)
    assert pulled.cone_margin == pytest.approx(-1.0 / F0, rel=1e-9)


def test_without_contacts_there_are_no_cone_entries() -> None:
    found = _certify(_contacts([], []), np.zeros((0, 3)))
    assert found.cone_margin is None
    assert found.min_normal_force is None


def _lowest(fixed: list[int]) -> float:
    """Lowest eigenvalue of differences of the plain energy, those vertices fixed."""
    step, dofs = 2e-5, np.flatnonzero(np.repeat(~np.isin(np.arange(12), fixed), 3))
    matrix = np.zeros((36, 36))
    for index in range(36):
        moved = np.zeros(36)
        moved[index] = step
        shift = moved.reshape(12, 3)
        ahead = total_forces(TERMS, POSE.vertices + shift, REST)
        behind = total_forces(TERMS, POSE.vertices - shift, REST)
        matrix[:, index] = ((ahead - behind) / (2.0 * step)).ravel()
    return float(np.linalg.eigvalsh((matrix + matrix.T)[np.ix_(dofs, dofs)] / 2)[0])


@pytest.mark.parametrize(
    ("push", "fixed"),
    [(1.0, [0, 4, 6, 7]), (2e-6, [0, 4, 6, 7]), (5e-7, [0, 4, 7]), (-1.0, [0, 4, 7])],
)
def test_contacts_hold_where_they_push(push: float, fixed: list[int]) -> None:
    """Fixed where f_N > 1e-6 f0, free otherwise; vertex 6 gets the force under test."""
    contacts = _contacts([6, 7], [0.5, 0.5])
    forces = F0 * np.array([push, 1.0])[:, None] * contacts.normals
    found = _certify(contacts, forces)
    assert found.min_eigenvalue == pytest.approx(_lowest(fixed), rel=1e-4)
    assert found.min_eigenvalue is not None
    assert found.min_eigenvalue_scaled == pytest.approx(
        found.min_eigenvalue * POSE.mean_edge_length / F0, rel=1e-12
    )
    assert found.neutral_modes == 0


def test_eigenvalue_equals_that_of_the_compiled_hessian() -> None:
    """NumPy differences against CasADi's exact Hessian, dense eigenvalues, 91 vertices."""
    ball = cap(5, 0.3, 1.0)
    rest = jittered(ball, 0.003).vertices
    terms = PlainShell(ball, bend=1e-4).terms()
    free = np.flatnonzero(np.repeat(ball.vertices[:, 2] < 0.27, 3))
    assembly = Assembly(terms, 91)
    exact = assembly.pattern.matrix(assembly.hessian(ball.vertices, rest)[1])
    plain = stiffness_matrix(terms, ball.vertices, rest, ball.mean_edge_length)
    assert abs(plain - exact).max() <= 1e-8 * abs(exact).max()
    wanted = np.linalg.eigvalsh(exact.toarray()[np.ix_(free, free)])
    found = lowest_eigenvalues(sp.csr_array(plain[free][:, free]), 4)
    assert found == pytest.approx(wanted[:4], rel=1e-5, abs=1e-8 * wanted[-1])


@pytest.mark.parametrize("negative", [0, 1, 7])
@pytest.mark.parametrize("size", [30, 300])
def test_lowest_eigenvalues_of_known_spectra(size: int, negative: int) -> None:
    """Tridiagonal matrix similar to diag(values): dense below 200, Lanczos above."""
    values = np.concatenate(
        [-np.linspace(5.0, 1.0, negative), np.linspace(0.5, 90.0, size - negative)]
    )
    angle = 0.3
    turn = sp.lil_array(sp.eye_array(size))
    for i in range(0, size - 1, 2):
        turn[i, i] = turn[i + 1, i + 1] = np.cos(angle)
        turn[i, i + 1], turn[i + 1, i] = -np.sin(angle), np.sin(angle)
    matrix = sp.csr_array(turn.tocsr() @ sp.diags_array(values) @ turn.tocsr().T)
    assert lowest_eigenvalues(matrix, 3) == pytest.approx(np.sort(values)[:3], rel=1e-8)


def test_no_free_vertex_has_no_eigenvalue() -> None:
    found = _certify(_contacts([], []), np.zeros((0, 3)), pinned=np.arange(12))
    assert found.min_eigenvalue is None
    assert found.min_eigenvalue_scaled is None
    assert found.free_force == 0.0


@pytest.mark.parametrize(
    ("pinned", "neutral"),
    [([], 6), ([5], 3), ([0, 11], 1), ([0, 2, 11], 0)],
    ids=["free", "one point", "two points", "three points"],
)
def test_rigid_motions_are_named_neutral(pinned: list[int], neutral: int) -> None:
    """A weightless shell at rest: 6 motions, 3 turns about a point, 1 about a line, none."""
    shell = PlainShell(POSE, gravity=(0.0, 0.0, 0.0)).terms()
    x, ids = POSE.vertices, np.array(pinned, dtype=np.int64)
    found, _ = certify(shell, x, x, x, Contacts.empty(), np.zeros((0, 3)), ids, 0.1)
    assert found.neutral_modes == neutral
    assert found.min_eigenvalue_scaled is not None
    assert (found.min_eigenvalue_scaled > 1e-7) == (neutral == 0)


def test_distance_is_relative_to_the_bounding_box() -> None:
    moved = POSE.vertices.copy()
    moved[3, 1] += 0.01
    found = _certify(_contacts([], []), np.zeros((0, 3)), pose=moved)
    assert found.target_distance == pytest.approx(0.01 / POSE.bbox_diagonal, rel=1e-9)


@pytest.mark.parametrize("which", ["pose", "rest", "contact_forces"])
def test_numbers_that_are_not_finite_give_an_empty_certificate(which: str) -> None:
    arrays = {"pose": POSE.vertices.copy(), "rest": REST.copy(), "contact_forces": np.ones((1, 3))}
    arrays[which][0, 0] = np.nan
    found, forces = certify(
        TERMS,
        POSE.vertices,
        arrays["pose"],
        arrays["rest"],
        _contacts([5], [0.5]),
        arrays["contact_forces"],
        PINS,
        0.1,
    )
    assert found.free_force is None
    assert found.min_eigenvalue is None
    assert np.all(np.isnan(forces))


def test_term_without_numpy_form_is_said_to_be_evaluated_by_casadi() -> None:
    terms = tuple(replace(term, reference=None) for term in TERMS)
    h = POSE.mean_edge_length
    empty = np.zeros((0, 3))
    found, forces = certify(
        terms, POSE.vertices, POSE.vertices, REST, Contacts.empty(), empty, PINS, h
    )
    assert found.evaluator == "casadi"
    assert forces == pytest.approx(total_forces(TERMS, POSE.vertices, REST), rel=1e-10, abs=1e-12)
    plain = _certify(_contacts([], []), empty)
    assert found.min_eigenvalue == pytest.approx(plain.min_eigenvalue, rel=1e-6)


@pytest.mark.parametrize("short", [1e-7, 1e-6, 1e-5])
def test_stiffness_of_a_hinge_about_to_fold_over(short: float) -> None:
    """The angle jumps from pi to -pi within the step of the differences, on one side only."""
    turn = np.pi - short
    mesh = TriMesh(
        [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0.1 * np.cos(turn), 0.1 * np.sin(turn)]],
        [[0, 1, 2], [1, 0, 3]],
    )
    terms, x = (hinge_bending(mesh, 1e-3),), mesh.vertices
    plain = stiffness_matrix(terms, x, x, 0.1).toarray()
    exact = Assembly(terms, 4)
    full = exact.pattern.matrix(exact.hessian(x, x)[1]).toarray()
    assert np.abs(plain - full).max() <= 1e-4 * np.abs(full).max()
