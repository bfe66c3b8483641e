"""The claims of figures of Ly 2018, in numbers, and the scripts that draw them."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from test_examples import ROOT, run

FOLDER = ROOT / "examples" / "figures"
SCRIPTS = sorted(FOLDER.glob("fig*.py"))


def _figure(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module(name)


def test_scripts_are_short_and_can_fail() -> None:
    assert len(SCRIPTS) >= 3
    for script in SCRIPTS:
        assert len(script.read_text().splitlines()) <= 90, script.name
        assert re.search(r"SystemExit\(|conclude\(", script.read_text()), script.name


def test_one_natural_shape_two_drapes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 4; distance, energies and eigenvalues are regressions."""
    found = _figure("fig04_two_drapes", monkeypatch).measure()
    for proof in found.proofs:
        assert proof.free_force <= 1e-8
        assert proof.min_eigenvalue_scaled > 0.03
    assert found.apart == pytest.approx(3.78, rel=0.05)
    assert found.energies == pytest.approx((-0.5216, -0.3869), rel=1e-3)


def test_step_two_brings_forces_into_their_cones(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 5."""
    _, (one, two) = _figure("fig05_forces", monkeypatch).measure()
    assert (one.margins < 0.0).all()
    assert (one.normal < 0.0).all()
    assert two.margins.min() > 0.1  # regression: 0.18
    assert two.normal.min() > 1.0
    assert max(one.free_force, two.free_force) <= 1e-8


def test_step_two_alone_leaves_its_target(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 12 at half the paper's bending stiffness; distances are regressions: 3.0 h and 0.02 h."""
    figure = _figure("fig12_step_two_alone", monkeypatch)
    alone, both = figure.measure((2.5e-3,), ("ipopt", "both steps"))
    assert figure.complaints([alone, both]) == []
    assert alone.unbalanced <= 1e-9
    assert alone.eigenvalue < -0.01
    assert alone.released.back > 0.5 * alone.released.h
    assert both.released.moved < 0.05 * both.released.h
    assert both.released.back < 1e-6 * both.released.h


def test_a_figure_that_does_not_show_its_claim_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the paper's stiffness and this size Step 2 alone is stable: no Fig. 12."""
    figure = _figure("fig12_step_two_alone", monkeypatch)
    (stable,) = figure.measure((5e-3,), ("ipopt",))
    assert stable.released.stays
    assert figure.complaints([stable]) == ["Step 2 alone is stable everywhere"]


def test_a_draped_ring_is_found_again_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 6, and one step further: `prefer=`."""
    figure = _figure("fig06_skirt_flattens", monkeypatch)
    scene, flat, free, near = figure.measure()
    draped, natural, ring = map(figure.shape, (scene.target.vertices, free.rest, flat))
    centred = [points - points.mean(axis=0) for points in (near.rest, flat)]
    left = float(np.linalg.norm(centred[0] - centred[1], axis=1).max())
    assert figure.complaints(draped, natural, ring, left) == []
    assert left < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_script_draws_its_picture(script: Path, tmp_path: Path) -> None:
    done = run([str(script), "--out", "pictures"], tmp_path)
    assert done.returncode == 0, done.stderr
    pictures = sorted((tmp_path / "pictures").glob(f"{script.stem.split('_')[0]}*.png"))
    assert pictures
    assert all(picture.stat().st_size > 20_000 for picture in pictures)
