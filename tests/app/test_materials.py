"""`casashell materials`: ranges, named materials, records, interrupts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from running import run

from casashell.app import materials
from casashell.app.builtin import page
from casashell.app.materials import Findings, explore, judge
from casashell.app.materials_table import lines_of, record_of
from casashell.app.named_materials import SHEETS, Sheet
from casashell.app.scene import Material, Scene
from casashell.result import Step
from casashell.solving import solve
from casashell.status import Status
from formulations.calibration import calibrate

STIFF = Sheet("board", 0.3, 1e5, 0.05, (0.1, 0.4))


def _page() -> Scene:
    return replace(page(7, 9), material=Material(density=0.5, stretch=50.0, bend=2e-3))


def test_a_stiff_board_holds_and_silk_does_not() -> None:
    """The verdict is that of a solve with the same numbers."""
    scene, found = _page(), Findings()
    board, silk = judge(scene, STIFF, found), judge(scene, SHEETS[0], found)
    fit = calibrate(scene.target)
    assert board.status is Status.SOLVED
    assert board.stretch == pytest.approx(fit.stretch * STIFF.membrane)
    made = Material(STIFF.density, board.stretch, board.bend)
    assert solve(replace(scene, material=made).problem).status is Status.SOLVED
    assert silk.status in (Status.TOO_SOFT, Status.ITERATION_LIMIT)
    assert silk.factor < 1.0


def test_the_command_prints_ranges_and_materials(page_file: Path, options: list[str]) -> None:
    outcome = run("materials", page_file, *options)
    assert outcome.exit_code == 0, outcome.output
    for word in ("bend", "stretch", "density", "friction", "all softer", "paper", "On this mesh"):
        assert word in outcome.stdout
    assert sorted(item.name for item in page_file.parent.iterdir()) == ["page.obj"]


def test_the_record_is_json_with_everything(page_file: Path, options: list[str]) -> None:
    outcome = run("materials", page_file, *options, "--json")
    record = json.loads(outcome.stdout)
    assert record["complete"]
    assert record["softest_factor"] == record["together"]["factor"] > 1.0
    assert set(record["alone"]) == set(record["stiffer_tested"]) == {"bend", "stretch"}
    assert 0.0 <= record["friction"]["solved"] <= 1.0
    assert [each["name"] for each in record["materials"]] == [sheet.name for sheet in SHEETS]
    for each in record["materials"]:
        assert each["status"] in set(Status)
        assert (each["status"] == "SOLVED") <= (each["factor"] >= 1.0)


def test_an_interrupt_keeps_what_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(name: str, step: Step) -> None:
        if name == SHEETS[1].name:
            raise KeyboardInterrupt

    monkeypatch.setattr(materials, "SHEETS", (STIFF, *SHEETS[1:]))
    scene = _page()
    found = explore(scene, stop)
    assert found.interrupted
    assert found.range.complete
    assert [each.sheet.name for each in found.verdicts] == ["board"]
    assert not record_of(found)["complete"]
    assert any("Hold the target: board" in line for line in lines_of(scene, found))


def test_bad_input_is_exit_code_2(page_file: Path) -> None:
    assert run("materials", page_file, "--bend", "-1").exit_code == 2


def test_no_material_is_lighter_than_air_or_stiffer_than_its_fibres() -> None:
    """Orders of magnitude of real sheets: a slip in the units of one of them would show."""
    for sheet in SHEETS:
        assert 0.02 <= sheet.density <= 2.0
        thickness = np.sqrt(12.0 * sheet.rigidity / sheet.membrane)  # of the homogeneous sheet
        assert 2e-5 <= thickness <= 5e-3
        assert 1e3 <= sheet.membrane <= 1e6
        assert 0.0 < sheet.friction[0] < sheet.friction[1] < 1.5
