"""What a user passes to a formulation: per-element arrays, and errors that name the element."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from meshes import grid, jittered

from casashell.engine.assembly import Assembly
from casashell.engine.energy import Energy
from casashell.mesh import TriMesh
from casashell.typing import ArrayLike
from formulations import area_gravity, discrete_shell, edge_stretch, hinge_bending, proximity

MESH = grid(2, 2)  # 9 vertices, 16 edges, 8 inside, 8 faces
BUILDERS: dict[str, tuple[Callable[[TriMesh, ArrayLike], Energy], str, int]] = {
    "stretch": (edge_stretch, "edge", 16),
    "bend": (hinge_bending, "hinge", 8),
    "density": (area_gravity, "face", 8),
    "pull": (proximity, "vertex", 9),
}


@pytest.mark.parametrize("name", list(BUILDERS))
def test_constant_array_equals_a_number(name: str) -> None:
    make, _, count = BUILDERS[name]
    pose = jittered(MESH, 0.01).vertices
    one = Assembly([make(MESH, 0.7)], 9).gradient(pose, MESH.vertices)
    many = Assembly([make(MESH, np.full(count, 0.7))], 9).gradient(pose, MESH.vertices)
    assert np.array_equal(one, many)


@pytest.mark.parametrize("name", list(BUILDERS))
def test_elements_have_their_own_material(name: str) -> None:
    """The energy of an array is the sum over its elements, one at a time."""
    make, _, count = BUILDERS[name]
    pose = jittered(MESH, 0.01).vertices
    values = np.linspace(0.5, 1.5, count)
    whole = make(MESH, values)
    assert whole.material[name].tolist() == values.tolist()
    tiny = 1e-300  # stretch refuses an exact zero
    total = 0.0
    for element, value in enumerate(values):
        alone = np.full(count, tiny)
        alone[element] = value
        total += Assembly([make(MESH, alone)], 9).energy(pose, MESH.vertices)
    assert Assembly([whole], 9).energy(pose, MESH.vertices) == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("wrong", [-1.0, np.nan, np.inf])
@pytest.mark.parametrize("name", list(BUILDERS))
def test_errors_name_the_parameter_and_the_element(name: str, wrong: float) -> None:
    make, element, count = BUILDERS[name]
    values = np.ones(count)
    values[3] = wrong
    with pytest.raises(ValueError, match=rf"{name}.* at {element} 3 must be finite and >"):
        make(MESH, values)
    with pytest.raises(ValueError, match=name):
        make(MESH, wrong)


@pytest.mark.parametrize("name", list(BUILDERS))
def test_errors_name_the_wanted_shape(name: str) -> None:
    make, element, count = BUILDERS[name]
    with pytest.raises(ValueError, match=rf"{name} .*per {element}, shape \({count},\).*\(5,\)"):
        make(MESH, np.ones(5))


def test_stretch_needs_stiffness_but_bending_and_density_may_be_zero() -> None:
    with pytest.raises(ValueError, match=r"stretch must be finite and > 0"):
        edge_stretch(MESH, 0.0)
    discrete_shell(MESH, density=0.0, stretch=1.0, bend=0.0)


@pytest.mark.parametrize("wrong", [(0.0, 0.0), (0.0, 0.0, np.nan), 9.81, (0, 0, 0, 1)])
def test_gravity_is_a_vector(wrong: ArrayLike) -> None:
    with pytest.raises(ValueError, match=r"gravity must be three finite numbers"):
        area_gravity(MESH, 0.2, wrong)


def test_material_is_copied() -> None:
    """A caller that changes his array later does not change the term."""
    values = np.ones(16)
    term = edge_stretch(MESH, values)
    values[:] = 5.0
    assert np.all(term.params == 1.0)
    assert np.all(term.material["stretch"] == 1.0)
