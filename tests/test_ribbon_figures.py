"""The claims of figures of Pan, Huang and Bao 2016, in numbers, and the scripts that draw them."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from test_examples import ROOT, run

FOLDER = ROOT / "examples" / "figures"
SCRIPTS = sorted(FOLDER.glob("pan*.py"))


def _figure(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.syspath_prepend(str(ROOT))
    return importlib.import_module(name)


def test_every_figure_has_a_script_that_can_fail() -> None:
    numbers = [int(script.stem[3:5]) for script in SCRIPTS]
    assert numbers == [2, 4, 6, 7, 8, 9, 10, 11, 12, 13]
    for script in SCRIPTS:
        text = script.read_text()
        assert len(text.splitlines()) <= 190, script.name
        assert "conclude(" in text


def test_a_rod_extended_is_not_isometric(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 2; the closed form is that of constant torsion."""
    figure = _figure("pan02_rod_extended", monkeypatch)
    found = figure.measure()
    assert figure.complaints(found) == []
    assert abs(found.ours) <= 1e-13
    assert found.rod == pytest.approx(found.exact, rel=0.02)
    wrong = figure.Measured(found.shape, found.rod, found.ours, found.exact)
    assert len(figure.complaints(wrong)) == 2


def test_fixed_rulings_cannot_turn_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 4, its first steps: with rulings straight across, normals keep to a plane (closed form)."""
    figure = _figure("pan04_fixed_rulings", monkeypatch)
    stay, always = (figure.measure_one(every, 10) for every in (0, 1))
    assert np.abs(stay.shape.normals[:, 1]).max() < 1e-4
    assert always.turned[-1] == pytest.approx(figure.GOAL[10], abs=1.0)


def test_stiffness_keeps_triangles_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 6; strains of 51 and 3.3 % are regressions."""
    figure = _figure("pan06_stiff_correction", monkeypatch)
    steps = figure.measure()
    assert figure.complaints(steps) == []
    soft, stiff = (max(step.strains[name] for step in steps) for name in figure.STIFFNESS)
    assert soft == pytest.approx(0.506, rel=0.1)
    assert stiff == pytest.approx(0.0325, rel=0.1)


def test_triangles_make_the_same_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 10: 2.5 % of the way in the step is a regression."""
    figure = _figure("pan10_kinetic_energy", monkeypatch)
    steps, coarse = figure.measure((10,))
    assert figure.complaints(steps, coarse) == []
    assert steps[0].moved == pytest.approx(0.025, rel=0.2)


def test_gradients_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 13 without its times."""
    found = _figure("pan13_gradient_cost", monkeypatch).measure((10, 20, 40), (10, 20, 40))
    assert found.apart <= 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_ribbon_script_draws_its_picture(script: Path, tmp_path: Path) -> None:
    done = run([str(script), "--out", "pictures"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "pictures" / f"{script.stem}.png").stat().st_size > 20_000
