"""`casashell invert --natural metric` and `casashell export`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from running import SILENT, run


@pytest.fixture
def solved(page_file: Path, options: list[str]) -> Path:
    out = page_file.parent / "out"
    outcome = run("invert", page_file, *options, "--natural", "metric", "--out", out, SILENT)
    assert outcome.exit_code == 0, outcome.output
    return out


def test_metric_is_written_beside_a_natural_mesh(solved: Path) -> None:
    """Lengths of metric.npz are those of natural.obj's edges (through result.npz, in m)."""
    record = json.loads((solved / "result.json").read_text())
    assert record["natural"] == "mesh"
    assert (solved / "natural.obj").is_file()
    assert 'natural = "metric"' in (solved / "scene.toml").read_text()
    with np.load(solved / "metric.npz") as metric, np.load(solved / "result.npz") as arrays:
        assert sorted(metric.files) == [
            *("edges", "hinges", "rest_angle", "rest_area", "rest_length"),
        ]
        ends = arrays["rest"][metric["edges"]]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        np.testing.assert_allclose(metric["rest_length"], lengths, rtol=1e-13)
        assert metric["rest_area"].shape == (len(arrays["faces"]),)


def test_export_writes_and_does_not_overwrite(solved: Path) -> None:
    for kind in ("newton", "vellum", "blender", "npz"):
        outcome = run("export", solved, "--to", kind)
        assert outcome.exit_code == 0, outcome.output
        for name in outcome.stdout.removeprefix("wrote ").split(" to ")[0].split(", "):
            assert (solved / kind / name).is_file()
    again = run("export", solved, "--to", "npz")
    assert again.exit_code == 2
    assert "--force" in again.stderr
    assert run("export", solved, "--to", "npz", "--force", "--quiet").stdout == ""


def test_what_export_cannot_do_is_said(solved: Path, tmp_path: Path) -> None:
    outcome = run("export", solved, "--to", "maya")
    assert outcome.exit_code == 2
    assert "newton, vellum, blender, npz" in outcome.stderr
    assert not (solved / "maya").exists()
    assert run("export", tmp_path / "nowhere", "--to", "npz").exit_code == 2
    assert "holds no result" in run("export", tmp_path, "--to", "npz").stderr
