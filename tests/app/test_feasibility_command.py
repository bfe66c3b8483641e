"""`casashell feasibility`: verdicts, exit codes, JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from running import run

#: A sheet of two triangles on a slope of 45 degrees, z up.
SLOPE = "v 0 0 0\nv 1 0 1\nv 1 1 1\nv 0 1 0\nf 1 2 3\nf 1 3 4\n"
PLANE = ("--plane", "-0.70710678118,0,0.70710678118,0", "--up", "z", "--tolerance", "1e-6")


@pytest.fixture
def slope(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """slope.obj in the working folder of the test."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "slope.obj"
    path.write_text(SLOPE)
    return path


def test_slippery_slope_is_exit_code_3(slope: Path) -> None:
    outcome = run("feasibility", slope, *PLANE, "--friction", "0.5")
    assert outcome.exit_code == 3, outcome.output
    assert "INFEASIBLE" in outcome.stdout
    assert "Proved: no natural shape holds this target" in outcome.stdout
    assert "It takes a friction of about 1 (the least now is 0.5)." in outcome.stdout  # tan 45
    assert [item.name for item in slope.parent.iterdir()] == ["slope.obj"]


def test_rough_slope_is_feasible(slope: Path) -> None:
    outcome = run("feasibility", slope, *PLANE, "--friction", "1.1", "--json")
    record = json.loads(outcome.stdout)
    assert outcome.exit_code == 0, outcome.output
    assert record["verdict"] == "FEASIBLE"
    (part,) = record["parts"]
    assert part["contacts"] == [0, 1, 2, 3]
    assert part["proof"] is None
    assert 1.0 / 1.1 <= part["state"]["friction_used"] <= 1.0


def test_proof_in_json(slope: Path) -> None:
    outcome = run("feasibility", slope, *PLANE, "--friction", "0.5", "--json")
    record = json.loads(outcome.stdout)
    assert outcome.exit_code == record["exit_code"] == 3
    (part,) = record["parts"]
    assert part["proof"]["holds"]
    assert part["proof"]["any_masses"]
    assert part["mending"]["sliding"] == [0, 1, 2, 3]
    assert part["mending"]["friction"] == pytest.approx(1.0, rel=0.02)
    assert part["mending"]["pins_suffice"]


def test_options_reach_the_problem(slope: Path) -> None:
    """Pins from the command line mend what the report says they mend."""
    pins = run("feasibility", slope, *PLANE, "--friction", "0.5", "--json")
    mend = ",".join(map(str, json.loads(pins.stdout)["parts"][0]["mending"]["pins"]))
    outcome = run("feasibility", slope, *PLANE, "--friction", "0.5", "--pin", mend, "--bend", "10")
    assert outcome.exit_code == 0, outcome.output


def test_too_soft_is_exit_code_1(page_file: Path, options: list[str]) -> None:
    """The page of the other tests is feasible; with a hundredth of its stiffness it is not."""
    assert run("feasibility", page_file, *options).exit_code == 0
    outcome = run("feasibility", page_file, *options, "--bend", "2e-5", "--quiet")
    assert outcome.exit_code == 1
    assert outcome.stdout == ""
    assert "TOO_SOFT" in outcome.stderr or "UNSTABLE" in outcome.stderr


def test_bad_input_is_exit_code_2(slope: Path) -> None:
    assert run("feasibility", "missing.obj").exit_code == 2
    assert run("feasibility", slope, "--friction", "-1").exit_code == 2
    assert run("feasibility", slope, "--seconds", "0").exit_code == 2
    slope.write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    outcome = run("feasibility", slope)
    assert outcome.exit_code == 2
    assert "Traceback" not in outcome.output
