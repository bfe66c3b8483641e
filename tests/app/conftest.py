"""A small scene on disk: a page of quads on a table, in centimetres, z up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from running import SILENT, run
from simulating import solved_page

from casashell.app.builtin import page
from casashell.io.meshes import write_mesh
from casashell.mesh import TriMesh

ACROSS, ALONG = 7, 6


@pytest.fixture
def quads() -> TriMesh:
    """The built-in page, small, as quads, turned to z up; m."""
    points = page(ACROSS, ALONG).target.vertices[:, [2, 0, 1]]
    number = np.arange(ACROSS * ALONG).reshape(ACROSS, ALONG)
    corners = (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1])
    polygons = np.stack([ids.ravel() for ids in corners], axis=1)
    faces = polygons[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return TriMesh(points, faces, tuple(map(tuple, polygons.tolist())))


@pytest.fixture
def page_file(tmp_path: Path, quads: TriMesh, monkeypatch: pytest.MonkeyPatch) -> Path:
    """page.obj in cm, in the working folder of the test."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "page.obj"
    write_mesh(path, quads, unit=0.01)
    return path


@pytest.fixture
def options() -> list[str]:
    """What makes page.obj solvable."""
    return [
        *("--plane", "0,0,1,0", "--unit", "cm", "--up", "z", "--tolerance", "0.001"),
        *("--density", "10", "--stretch", "5", "--bend", "2e-3", "--friction", "0.4"),
    ]


@pytest.fixture
def solved(page_file: Path, options: list[str]) -> Path:
    """Folder of a solved page."""
    outcome = run("invert", page_file, *options, "--out", "out", SILENT)
    assert outcome.exit_code == 0, outcome.output
    return page_file.parent / "out"


@pytest.fixture(scope="session")
def page_on_mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a solved page on a mesh, for all tests that do not change it."""
    return solved_page(tmp_path_factory.mktemp("solved") / "page")
