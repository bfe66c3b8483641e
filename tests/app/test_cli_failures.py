"""What may go wrong: exit codes, messages, and what is left on disk."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from running import SILENT, run

from casashell.app import invert
from casashell.app.display import Reporter
from casashell.io import pictures
from casashell.result import Step


def test_full_folder_is_refused_before_any_work(page_file: Path, options: list[str]) -> None:
    Path("out").mkdir()
    Path("out/notes.txt").write_text("mine")
    outcome = run("invert", "missing.obj", *options, "--out", "out")
    assert outcome.exit_code == 2
    assert "--force" in outcome.stderr
    assert [item.name for item in Path("out").iterdir()] == ["notes.txt"]


def test_force_replaces_the_result_and_nothing_else(solved: Path, options: list[str]) -> None:
    (solved / "notes.txt").write_text("mine")
    for stale in ("obstacle-7.obj", "overview.png"):
        (solved / stale).write_text("old")
    outcome = run("invert", "page.obj", *options, "--out", solved, "--force", SILENT)
    assert outcome.exit_code == 0, outcome.output
    assert (solved / "notes.txt").read_text() == "mine"
    assert not (solved / "obstacle-7.obj").exists()
    assert not (solved / "overview.png").exists()


def test_an_input_is_not_overwritten(solved: Path) -> None:
    before = (solved / "scene.toml").read_bytes()
    outcome = run("invert", solved / "scene.toml", "--out", solved, "--force", SILENT)
    assert outcome.exit_code == 2
    assert "input" in outcome.stderr
    assert (solved / "scene.toml").read_bytes() == before


BAD_INPUT = {
    "missing shell": (["missing.obj"], "missing.obj"),
    "folder as shell": (["."], "folder"),
    "missing obstacle": (["page.obj", "--obstacle", "body.obj"], "body.obj"),
    "obstacle with nan": (["page.obj", "--obstacle", "nan.obj"], "vertex 1 is not finite"),
    "plane of three numbers": (["page.obj", "--plane", "0,0,1"], "NX,NY,NZ,D"),
    "plane without direction": (["page.obj", "--plane", "0,0,0,1"], "normal"),
    "pin out of range": (["page.obj", "--pin", "3,42"], "42"),
    "negative pin": (["page.obj", "--pin", "-1"], "-1"),
    "pin file with words": (["page.obj", "--pin", "pins.txt"], "line 2"),
    "pin file without ids": (["page.obj", "--pin", "nopins.txt"], "no vertex ids"),
    "pins with a word": (["page.obj", "--pin", "3,four"], "whole numbers"),
    "pin of nothing": (["page.obj", "--pin", ""], "whole numbers"),
    "missing pin file": (["page.obj", "--pin", "none.txt"], "none.txt"),
    "unknown unit": (["page.obj", "--unit", "foot"], "dm"),
    "unit zero": (["page.obj", "--unit", "0"], "unit"),
    "absurd unit": (["page.obj", "--unit", "1e12"], "its unit"),
    "unknown axis": (["page.obj", "--up", "w"], "x, y or z"),
    "gravity nan": (["page.obj", "--gravity", "nan"], "finite"),
    "gravity upwards": (["page.obj", "--gravity", "-9.81"], "-up"),
    "negative friction": (["page.obj", "--friction", "-1"], "friction"),
    "negative tolerance": (["page.obj", "--tolerance", "-1"], "tolerance"),
    "density not a number": (["page.obj", "--density", "heavy"], "density"),
    "negative bend": (["page.obj", "--bend", "-1"], "bend"),
    "unknown method": (["page.obj", "--method", "magic"], "auto, direct, two-step, nlp"),
    "unknown step2": (["page.obj", "--step2", "magic"], "ipopt or bfgs"),
    "natural": (["page.obj", "--natural", "moebius"], "mesh or metric"),
    "unknown option": (["page.obj", "--metod", "direct"], "--metod"),
    "number expected": (["page.obj", "--gravity", "down"], "--gravity"),
    "loose vertex": (["loose.obj"], "--repair"),
    "beyond repair": (["fan.obj", "--repair"], "what --repair leaves"),
    "broken toml": (["broken.toml"], "broken.toml"),
    "unknown key": (["unknown.toml"], "did you mean 'density'"),
    "file in the way": (["page.obj", "--out", "page.obj"], "page.obj"),
    "file on the way": (["page.obj", "--out", "page.obj/out"], "page.obj"),
}


@pytest.mark.parametrize("name", BAD_INPUT)
def test_bad_input_is_exit_code_2_and_writes_nothing(page_file: Path, name: str) -> None:
    arguments, message = BAD_INPUT[name]
    Path("nan.obj").write_text("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n")
    Path("loose.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\n")
    fan = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nf 1 2 3\nf 2 1 4\nf 1 2 5\n"
    Path("fan.obj").write_text(fan)
    Path("pins.txt").write_text("3\nfour\n")
    Path("nopins.txt").write_text("# none\n")
    Path("broken.toml").write_text("[shell\n")
    Path("unknown.toml").write_text('[shell]\nfile = "page.obj"\n[material]\ndensty = 1\n')
    before = sorted(Path().rglob("*"))
    target = [] if "--out" in arguments else ["--out", "out"]
    outcome = run("invert", *arguments, *target)
    assert outcome.exit_code == 2, outcome.output
    assert message in outcome.stderr
    assert "Traceback" not in outcome.output
    assert sorted(Path().rglob("*")) == before


def test_a_shell_too_soft_is_exit_code_1_and_labelled(page_file: Path, options: list[str]) -> None:
    outcome = run("invert", page_file, *options, "--bend", "1e-9", "--out", "out", SILENT)
    assert outcome.exit_code == 1, outcome.output
    status = json.loads(Path("out/result.json").read_text())["status"]
    assert status not in ("SOLVED", "SOLVED_NEARBY")
    first = Path("out/natural.obj").read_text().splitlines()[0]
    assert status in first
    assert "not certified" in first


def test_a_shell_nothing_holds_is_exit_code_3(page_file: Path) -> None:
    outcome = run("invert", page_file, "--unit", "cm", "--out", "out", SILENT, "--quiet")
    assert outcome.exit_code == 3
    assert "INFEASIBLE" in outcome.stderr
    assert json.loads(Path("out/result.json").read_text())["status"] == "INFEASIBLE"


def test_interrupt_keeps_the_best_so_far(
    page_file: Path, options: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(step: Step) -> None:
        raise KeyboardInterrupt

    @contextmanager
    def live(self: Reporter) -> Iterator[object]:
        yield stop

    monkeypatch.setattr(Reporter, "live", live)
    outcome = run("invert", page_file, *options, "--out", "out")
    assert outcome.exit_code == 130, outcome.output
    assert not list(Path("out").glob("*.png"))  # nobody waits for pictures of that
    assert json.loads(Path("out/result.json").read_text())["status"] == "INTERRUPTED"
    assert "INTERRUPTED" in Path("out/natural.obj").read_text().splitlines()[0]


def test_interrupt_while_reading_writes_nothing(
    page_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(invert, "describe", stop)
    assert run("invert", page_file, "--out", "out").exit_code == 130
    assert not Path("out").exists()


def test_unexpected_error_is_one_line_unless_debugging(
    page_file: Path, options: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("broken inside")

    monkeypatch.setattr(invert, "solve", fail)
    outcome = run("invert", page_file, *options, "--out", "out")
    assert outcome.exit_code == 1
    assert "broken inside" in outcome.stderr
    assert "--debug" in outcome.stderr
    assert "Traceback" not in outcome.output
    assert not Path("out").exists()
    debugged = run("invert", page_file, *options, "--out", "out", "--debug")
    assert isinstance(debugged.exception, RuntimeError)


def test_missing_pictures_are_a_line_not_an_error(
    page_file: Path, options: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def unavailable(*_: object, **__: object) -> None:
        raise pictures.PicturesUnavailable("install casashell[viz]")

    monkeypatch.setattr(pictures, "write_pictures", unavailable)
    outcome = run("invert", page_file, *options, "--out", "out")
    assert outcome.exit_code == 0, outcome.output
    assert outcome.stdout.count("casashell[viz]") == 1
    assert Path("out/result.json").is_file()
