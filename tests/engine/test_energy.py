"""What an energy term refuses at construction, and how it is cut into parts."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from meshes import grid

from casashell.engine.energy import Energy
from formulations import edge_stretch
from formulations.edge_stretch import density

STENCILS = np.array([[0, 1], [1, 2]])
PARAMS = np.ones((2, 1))


def _function(
    columns_x: int = 2, columns_r: int = 2, rows: int = 3, outputs: int = 1
) -> ca.Function:
    x, r, p = ca.SX.sym("x", rows, columns_x), ca.SX.sym("r", rows, columns_r), ca.SX.sym("p", 1)
    return ca.Function("wrong", [x, r, p], [ca.repmat(ca.sumsqr(x) * p, outputs, 1)])


def test_stencils_and_params_have_to_suit_the_density() -> None:
    with pytest.raises(ValueError, match=r"'spring': stencils must be \(S, 2\).*\(2, 3\)"):
        Energy("spring", density(), np.zeros((2, 3), dtype=int), PARAMS)
    with pytest.raises(ValueError, match=r"'spring': params must be \(2, 1\).*\(2, 2\)"):
        Energy("spring", density(), STENCILS, np.ones((2, 2)))
    with pytest.raises(ValueError, match=r"'spring': params of element 1 are not finite"):
        Energy("spring", density(), STENCILS, np.array([[1.0], [np.nan]]))


@pytest.mark.parametrize(
    "wrong",
    [
        _function(columns_r=3),
        _function(rows=2),
        _function(outputs=2),
        ca.Function("two", [ca.SX.sym("x", 3, 2)], [ca.SX(1)]),
        ca.Function("graph", [*map(ca.MX.sym, "xr", (3, 3), (2, 2)), ca.MX.sym("p")], [ca.MX(1)]),
    ],
    ids=["x and r differ", "not 3 rows", "a vector", "one argument", "MX"],
)
def test_density_has_to_be_a_scalar_sx_function_of_x_r_p(wrong: ca.Function) -> None:
    with pytest.raises(ValueError, match=r"'spring': density must"):
        Energy("spring", wrong, STENCILS, PARAMS)


def test_restriction_renumbers_and_keeps_the_parameters() -> None:
    term = Energy(
        "spring", density(), np.array([[0, 1], [3, 4], [4, 5]]), np.array([[1.0], [2], [3]])
    )
    part = term.restricted(np.array([False, True, True]), np.array([-1, -1, -1, 0, 1, 2]))
    assert part.stencils.tolist() == [[0, 1], [1, 2]]
    assert part.params.ravel().tolist() == [2.0, 3.0]
    assert part.density is term.density


def test_term_without_zeros_is_itself() -> None:
    term = edge_stretch(grid(1, 1), 2.0)
    assert term.without_idle() is term
    some = replace(term, params=np.array([[0.0], [1], [0], [0], [2]]))
    assert some.without_idle().params.ravel().tolist() == [1.0, 2.0]
    assert np.array_equal(some.without_idle().stencils, term.stencils[[1, 4]])
