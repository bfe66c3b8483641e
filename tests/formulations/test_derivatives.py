"""Kernels of every formulation against central differences, each other and the NumPy form."""

from __future__ import annotations

import numpy as np
import pytest
from catalogue import NAMES, Case, case

from casashell.engine.kernels import KERNELS, get_kernel
from casashell.inverse.certificate import stencil_forces, stencil_stiffness
from casashell.typing import FloatArray

STEPS = (4e-3, 2e-3, 1e-3)  # m, on edges of 0.1 m: truncation far above rounding

# What the differences have to show, from the formulas: "order 2" where the derivative that is
# differenced is not a polynomial of degree two in the variable that moves; "exact" where it is, so
# that central differences have no error; "zero" where there is no dependence at all.
EXPECTED = {
    "stretch": {
        **dict.fromkeys(("gradient", "hessian", "mixed", "lagrangian"), "order 2"),
        "twice": "order 2",
        "cross": "exact",  # E = k/2 (L^2/Lbar - 2L + Lbar): what couples x and r is quadratic in x
    },
    "bend": dict.fromkeys(
        ("gradient", "hessian", "mixed", "lagrangian", "cross", "twice"), "order 2"
    ),
    "gravity": {
        "gradient": "exact",  # linear in x
        "hessian": "zero",
        "mixed": "order 2",  # through the natural area
        "lagrangian": "order 2",
        "cross": "zero",
        "twice": "zero",
    },
    "proximity": {
        "gradient": "exact",  # quadratic in x
        "hessian": "exact",
        "mixed": "zero",
        "lagrangian": "zero",
        "cross": "zero",
        "twice": "zero",
    },
}


def _last(case_: Case, kernel: str, x: FloatArray, r: FloatArray, rows: int) -> FloatArray:
    """Last output of a kernel as (S, rows, columns); zeros where it is identically zero."""
    made = case_.run(kernel, x, r)[-1]
    size = 3 * case_.term.size
    if made.shape[1] == 0:
        return np.zeros((len(made), rows, size))
    return np.asarray(made.reshape(len(made), rows, -1))


def _pairs(case_: Case, name: str, d: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """(differences, derivative) along direction ``d`` per stencil, flattened."""
    x, r, size = case_.x, case_.r, 3 * case_.term.size
    local = d[case_.term.stencils].reshape(-1, size)
    multiplier = case_.w[case_.term.stencils].reshape(-1, size)

    def pull(x: FloatArray, r: FloatArray) -> FloatArray:
        """d(w.g)/dr, the mixed block applied to the multipliers from the left."""
        return np.asarray(np.einsum("si,sij->sj", multiplier, _last(case_, "mixed", x, r, size)))

    def bent(x: FloatArray, r: FloatArray) -> FloatArray:
        """d(w.g)/dx, the Hessian applied to the multipliers."""
        return np.asarray(np.einsum("si,sij->sj", multiplier, _last(case_, "hessian", x, r, size)))

    moves_r = name in ("mixed", "lagrangian")
    of = {
        "gradient": lambda x, r: case_.run("energy", x, r)[0],
        "hessian": lambda x, r: case_.run("gradient", x, r)[0],
        "mixed": lambda x, r: case_.run("gradient", x, r)[0],
        "lagrangian": pull,
        "cross": pull,
        "twice": bent,
    }[name]
    ahead = of(x, r + step * d) if moves_r else of(x + step * d, r)
    behind = of(x, r - step * d) if moves_r else of(x - step * d, r)
    kernel = {"cross": "lagrangian_mixed", "twice": "lagrangian_pose"}.get(name, name)
    rows = 1 if name == "gradient" else size
    wanted = np.einsum("sij,sj->si", _last(case_, kernel, x, r, rows), local)
    return (ahead - behind) / (2.0 * step), wanted


@pytest.mark.parametrize("kernel", ["gradient", "hessian", "mixed", "lagrangian", "cross", "twice"])
@pytest.mark.parametrize("name", NAMES)
def test_central_differences_converge_with_order_two(name: str, kernel: str) -> None:
    this = case(name)
    d = np.random.default_rng(4).standard_normal(this.x.shape)
    errors = []
    for step in STEPS:
        found, wanted = _pairs(this, kernel, d, step)
        errors.append(np.abs(found - wanted).max())
    size = np.abs(wanted).max()
    expected = EXPECTED[name][kernel]
    if expected == "zero":
        assert size == 0.0
        assert max(errors) == 0.0
    elif expected == "exact":
        assert size > 0.0
        assert max(errors) <= 1e-11 * size
    else:
        order = np.polyfit(np.log(STEPS), np.log(errors), 1)[0]
        assert order == pytest.approx(2.0, abs=0.1)
        assert errors[-1] <= 0.05 * size


@pytest.mark.parametrize("kernel", list(KERNELS))
@pytest.mark.parametrize("name", NAMES)
def test_compiled_and_interpreted_kernels_agree(name: str, kernel: str) -> None:
    """Same arithmetic, so 1e-12 relative; outputs that vanish identically are empty in both."""
    this = case(name)
    compiled = this.run(kernel, this.x, this.r)
    interpreted = this.run(kernel, this.x, this.r, interpreted=True)
    assert not get_kernel(this.term.density, kernel, interpreted=True).compiled
    assert len(compiled) == len(interpreted) == len(KERNELS[kernel])
    for one, other in zip(compiled, interpreted, strict=True):
        assert one.shape == other.shape
        assert np.abs(one - other).max(initial=0.0) <= 1e-12 * np.abs(other).max(initial=0.0)


@pytest.mark.parametrize("name", NAMES)
def test_hessian_blocks_are_symmetric(name: str) -> None:
    this = case(name)
    for kernel in ("hessian", "lagrangian"):
        block = _last(this, kernel, this.x, this.r, 3 * this.term.size)
        assert block == pytest.approx(block.transpose(0, 2, 1), rel=0, abs=1e-12 * np.ptp(block))


@pytest.mark.parametrize("name", NAMES)
def test_numpy_form_equals_the_symbolic_density(name: str) -> None:
    """Two transcriptions of one formula, from different geometric constructions."""
    this = case(name)
    assert this.term.reference is not None
    rest = np.moveaxis(this.r[this.term.stencils], 0, 2)
    pose = np.moveaxis(this.x[this.term.stencils], 0, 2)
    plain = this.term.reference(rest, this.term.params.T)(pose)
    symbolic = this.run("energy", this.x, this.r, interpreted=True)[0][:, 0]
    assert plain == pytest.approx(symbolic, rel=1e-12, abs=1e-13 * np.abs(symbolic).max())


@pytest.mark.parametrize("name", NAMES)
def test_certificate_derivatives_equal_the_kernels(name: str) -> None:
    """Complex step is exact to rounding; its central difference has an error of (1e-5)^2."""
    this = case(name)
    force = this.run("gradient", this.x, this.r)[0]
    plain = stencil_forces(this.term, this.x, this.r).reshape(force.shape)
    assert np.abs(plain - force).max() <= 1e-12 * np.abs(force).max()
    block = _last(this, "hessian", this.x, this.r, 3 * this.term.size)
    stiffness = stencil_stiffness(this.term, this.x, this.r, 0.1)
    assert np.abs(stiffness - block).max() <= 1e-8 * np.abs(block).max() + 1e-12
