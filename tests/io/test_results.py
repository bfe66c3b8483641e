"""Result folders: saved, loaded, replaced, and never half written."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from casashell import Result, Status, solve
from casashell.app.builtin import page
from casashell.contact.obstacles import Plane
from casashell.io import results
from casashell.io.results import load_result, save_result
from casashell.io.toml_tables import read_toml, write_table
from casashell.result import NotConverged
from casashell.typing import ArrayLike, FloatArray


@pytest.fixture(scope="module")
def result() -> Result:
    """A solved page of 25 vertices."""
    scene = page(5, 5)
    return dataclasses.replace(solve(scene.problem), contact_tolerance=scene.tolerance)


def test_what_is_saved_is_loaded(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "out", unit=0.01)
    loaded = Result.load(tmp_path / "out")
    for field in dataclasses.fields(Result):
        before, after = getattr(result, field.name), getattr(loaded, field.name)
        if isinstance(before, np.ndarray):
            np.testing.assert_array_equal(after, before)
        elif field.name not in ("target", "contacts", "material", "energies"):
            assert after == before, field.name
    assert loaded.energies == ()  # a file knows the material, not the functions
    np.testing.assert_array_equal(loaded.target.vertices, result.target.vertices)
    np.testing.assert_array_equal(loaded.target.faces, result.target.faces)
    for field in dataclasses.fields(result.contacts):
        before = getattr(result.contacts, field.name)
        np.testing.assert_array_equal(getattr(loaded.contacts, field.name), before)
    assert set(loaded.material) == {*("edges", "hinges", "stretch", "bend", "density", "gravity")}
    for key, value in loaded.material.items():
        np.testing.assert_array_equal(value, result.material[key])


def test_require_returns_certified_results_only(result: Result) -> None:
    assert result.require() is result
    soft = dataclasses.replace(result, status=Status.TOO_SOFT, advice="Raise bend.")
    with pytest.raises(NotConverged, match=r"TOO_SOFT: Raise bend\.") as caught:
        soft.require()
    assert caught.value.result is soft


def test_an_existing_result_needs_overwrite(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path)  # empty: filled in place
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "obstacle-3.obj").write_text("of an earlier result")
    with pytest.raises(FileExistsError):
        result.save(tmp_path)
    result.save(tmp_path, overwrite=True, unit=0.1)
    assert json.loads((tmp_path / "result.json").read_text())["unit"] == 0.1
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert not (tmp_path / "obstacle-3.obj").exists()
    assert not list(tmp_path.glob(".casashell-*"))


@pytest.mark.parametrize("existing", [False, True])
def test_a_failure_while_writing_leaves_things_as_they_were(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, existing: bool
) -> None:
    folder = tmp_path / "a" / "out"
    if existing:
        result.save(folder)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def fail(*_: object, **__: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(results, "write_scene", fail)
    with pytest.raises(OSError, match="disk full"):
        result.save(folder, overwrite=True)
    after = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert after == before
    assert folder.exists() == existing


def test_numbers_that_are_not_finite(result: Result, tmp_path: Path) -> None:
    """result.json stays strict JSON; a shape with NaN is in the arrays, not among the meshes."""
    rest = result.rest.copy()
    rest[0] = math.nan
    broken = dataclasses.replace(
        result,
        status=Status.NONFINITE,
        rest=rest,
        certificate=dataclasses.replace(result.certificate, free_force=None, f0=math.inf),
        quality=dataclasses.replace(result.quality, max_stretch=math.nan),
    )
    broken.save(tmp_path / "out")

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    text = (tmp_path / "out" / "result.json").read_text()
    record = json.loads(text, parse_constant=refuse)
    assert record["quality"]["max_stretch"] is None
    assert not (tmp_path / "out" / "natural.obj").exists()
    loaded = load_result(tmp_path / "out")
    assert loaded.certificate.free_force is None
    assert math.isnan(loaded.quality.max_stretch)
    np.testing.assert_array_equal(loaded.rest, rest)


class Dunes:
    """An obstacle of a class of the user's own."""

    friction, name = 0.5, "dunes"

    def signed_distance(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        return Plane((0.0, 1.0, 0.0)).signed_distance(points)

    def bounding_box(self) -> None:
        return None


def test_obstacles_of_own_classes_are_named_not_restored(result: Result, tmp_path: Path) -> None:
    dataclasses.replace(result, obstacles=(Dunes(),)).save(tmp_path / "out")
    loaded = load_result(tmp_path / "out")
    assert loaded.obstacles == ()
    assert len(loaded.contacts) == len(result.contacts)
    assert "own" in loaded.notes[-1]


def test_vertex_map(result: Result, tmp_path: Path) -> None:
    names = save_result(result, tmp_path / "out", vertex_map=np.array([1, -1, 0]))
    assert "vertex_map.txt" in names
    lines = (tmp_path / "out" / "vertex_map.txt").read_text().splitlines()
    assert lines[1:] == ["0 1", "1 -1", "2 0"]


def test_folders_without_a_result(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds no result"):
        load_result(tmp_path)
    (tmp_path / "result.json").write_text("{}")
    np.savez(tmp_path / "result.npz")
    with pytest.raises(ValueError, match="no readable result"):
        load_result(tmp_path)


def test_wrong_unit(result: Result, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="unit"):
        result.save(tmp_path / "out", unit=0.0)


def test_tables_read_back_as_written(tmp_path: Path) -> None:
    values = {
        "text": 'a "b" \\ \n \x7f \u00e9',
        "flag": True,
        "count": 3,
        "tiny": 1e-17,
        "huge": 1e300,
        "vector": [0.1, -2.0, 3.0],
    }
    (tmp_path / "t.toml").write_text(write_table("[table]", values), encoding="utf-8")
    assert read_toml(tmp_path / "t.toml") == {"table": values}
