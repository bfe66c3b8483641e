"""`casashell invert`: read, solve, save, report."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

from casashell.app.artwork import add_pictures, add_report
from casashell.app.display import Reporter
from casashell.app.failures import CommandError, reading_input, writing_files
from casashell.app.hints import hints
from casashell.app.options import SceneOptions
from casashell.app.scene import Scene, SceneSpec
from casashell.contact.detect import describe
from casashell.inverse.methods import PRESETS, Choice
from casashell.inverse.warm_start import WarmStart
from casashell.io.results import load_result, owned, record_of, save_result
from casashell.io.staging import check_folder
from casashell.result import Result
from casashell.solving import solve
from casashell.status import Status


@dataclass(frozen=True)
class OutputOptions:
    """Where the result goes and what is printed."""

    out: Path | None = None
    force: bool = False
    pictures: bool = True
    quiet: bool = False
    as_json: bool = False


@dataclass
class Clock:
    """Seconds by what they were spent on."""

    timings: dict[str, float] = field(default_factory=dict)
    last: float = field(default_factory=time.perf_counter)

    def lap(self, name: str) -> None:
        """Book the time since the last lap."""
        now = time.perf_counter()
        self.timings[name] = now - self.last
        self.last = now


def run_invert(
    options: SceneOptions, output: OutputOptions, *, repair: bool, start: Path | None = None
) -> int:
    """The whole command; the exit code.  Raises CommandError for what the user can mend.

    start  folder of an earlier result to begin with
    """
    clock = Clock()
    folder = output.out or Path(f"{options.shell.stem}-natural")
    _check_out(folder, output.force)
    with reading_input(mended=repair):
        spec = options.spec()
        _check_inputs_survive(spec, folder)
        scene = spec.load(repair=repair)
        contacts = describe(scene.problem.contacts, scene.obstacles)
        earlier = None if start is None else load_result(start)
        if earlier is not None:
            require_start(earlier, scene)
    reporter = Reporter(quiet=output.quiet or output.as_json)
    reporter.scene(scene, contacts)
    for finding in scene.problem.findings:
        reporter.line(f"{finding.severity}: {finding.message}")
    for hint in hints(scene):
        reporter.line(f"hint: {hint}")
    clock.lap("read")
    result = solve_scene(scene, reporter, earlier)
    clock.lap("solve")
    store(scene, result, folder, output, reporter, clock)
    if output.as_json:
        print(json.dumps(record_of(result, scene.unit), indent=1, allow_nan=False))
    return result.status.exit_code


def require_start(earlier: Result, scene: Scene) -> None:
    """ValueError unless this result can be the start of this scene."""
    Choice(scene.method, scene.step2, PRESETS[0], None, WarmStart(earlier, scene.problem))


def solve_scene(scene: Scene, reporter: Reporter, start: Result | None = None) -> Result:
    """Solve with a live line; the result knows the tolerance of the scene."""
    with reporter.live() as callback:
        result = solve(
            scene.problem,
            scene.method,
            step2=scene.step2,
            prefer=scene.prefer,
            natural=scene.natural,
            start=start,
            callback=callback,
        )
    return replace(result, contact_tolerance=scene.problem.tolerance)


def store(
    scene: Scene,
    result: Result,
    folder: Path,
    output: OutputOptions,
    reporter: Reporter,
    clock: Clock,
) -> None:
    """Save the result, then say how it went, then draw: a fault in drawing loses nothing."""
    with writing_files():
        names = save_result(
            result,
            folder,
            unit=scene.unit,
            name=scene.name,
            overwrite=output.force,
            vertex_map=scene.vertex_map,
        )
    clock.lap("save")
    reporter.verdict(result)
    with writing_files():
        names += add_report(result, folder, scene.name, scene.up_vector)
    clock.lap("report")
    remark = None
    if output.pictures and result.status is not Status.INTERRUPTED:  # nobody waits for them
        drawn, remark = add_pictures(result, folder, scene.up_vector)
        names += drawn
        clock.lap("pictures")
    reporter.files(folder, names, clock.timings)
    if remark:
        reporter.line(remark)


def _check_out(folder: Path, force: bool) -> None:
    try:
        check_folder(folder, overwrite=force)
    except FileExistsError as problem:
        raise CommandError(f"{problem}: choose another --out or add --force") from None
    except NotADirectoryError as problem:
        raise CommandError(f"--out: {problem}") from None
    except OSError as problem:
        raise CommandError(f"--out {folder}: cannot write there: {problem.strerror}") from None


def _check_inputs_survive(spec: SceneSpec, folder: Path) -> None:
    """CommandError if the result would overwrite a file it is made from."""
    place = folder.resolve()
    for path in spec.inputs:
        if path.resolve().parent == place and owned(path.name) and path.exists():
            raise CommandError(
                f"{path} is an input of this scene and the result would replace it: "
                "choose another --out"
            )
