"""Exported C: built with the system compiler, run, compared with Python."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from casashell import Problem, TriMesh, codegen
from casashell.engine.assembly import Assembly
from formulations import discrete_shell, edge_stretch


def bent_patch() -> TriMesh:
    """Nine vertices on a paraboloid, eight faces."""
    s, t = (a.ravel() for a in np.meshgrid([0.0, 0.4, 1.0], [0.0, 0.5, 1.0]))
    corner = np.arange(9).reshape(3, 3)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    faces = np.concatenate([np.stack(q, axis=-1).reshape(-1, 3) for q in ((a, b, d), (a, d, c))])
    return TriMesh(np.column_stack([s, t, 0.2 * s * s + 0.1 * s * t]), faces)


def printed(folder: Path) -> dict[str, np.ndarray]:
    """Build and run the example; its numbers by name."""
    subprocess.run(["make", "-s", "-C", str(folder), "example"], check=True, capture_output=True)
    out = subprocess.run([str(folder / "example")], check=True, capture_output=True, text=True)
    rows = [line.split() for line in out.stdout.splitlines()]
    return {
        name: np.array([float(value) for key, value in rows if key == name])
        for name in ("F", "DxF", "DrF")
    }


needs_make = pytest.mark.skipif(
    not (shutil.which("make") and shutil.which("cc")), reason="needs make and a C compiler"
)


@needs_make
def test_the_exported_program_agrees_with_python(tmp_path: Path) -> None:
    mesh = bent_patch()
    # Two terms of one formulation must not clash when linked.
    extra = replace(edge_stretch(mesh, 2.0), name="second stretch")
    terms = (*discrete_shell(mesh, density=0.3, stretch=11.0, bend=0.02), extra)
    problem = Problem(mesh, terms, pinned=[0, 1, 2])
    codegen(problem, tmp_path / "c")
    got = printed(tmp_path / "c")
    x, r = mesh.vertices, 1.01 * mesh.vertices
    assembly = Assembly(terms, 9)
    gradient, hessian = assembly.hessian(x, r)
    _, mixed = assembly.mixed(x, r)
    direction = np.arange(1.0, 28.0)
    wanted = {
        "F": -gradient.ravel(),
        "DxF": -assembly.pattern.matrix(hessian) @ direction,
        "DrF": -assembly.pattern.matrix(mixed) @ direction,
    }
    for name, value in wanted.items():
        np.testing.assert_allclose(got[name], value, rtol=0, atol=1e-12 * np.abs(value).max())


@needs_make
def test_the_c_code_is_standard_c99_without_warnings(tmp_path: Path) -> None:
    mesh = bent_patch()
    codegen(Problem(mesh, discrete_shell(mesh, density=0.3, stretch=1.0, bend=0.1)), tmp_path / "c")
    for name in ("shell.c", "example.c"):
        command = ["cc", "-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-fsyntax-only"]
        subprocess.run([*command, str(tmp_path / "c" / name)], check=True)


def test_an_existing_directory_is_not_overwritten(tmp_path: Path) -> None:
    mesh = bent_patch()
    problem = Problem(mesh, discrete_shell(mesh, density=0.3, stretch=1.0, bend=0.1))
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(FileExistsError, match="not empty"):
        codegen(problem, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]
