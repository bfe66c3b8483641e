"""`casashell simulate`: a result and its scene, moved through time and written to a folder."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from casashell.app import simulate_output as output
from casashell.app.failures import (
    FAILURE,
    INTERRUPTED,
    CommandError,
    reading_input,
    reason,
    writing_files,
)
from casashell.app.motion_files import motion_files
from casashell.app.simulate_display import Clock, SimulationReporter
from casashell.app.simulate_options import SimulateOptions
from casashell.app.simulate_plan import Plan, read_plan, remarks, settings, summary
from casashell.dynamics.motion import Motion
from casashell.dynamics.simulate import simulate
from casashell.dynamics.simulation import Frame, Simulation, SimulationStatus
from casashell.io.staging import check_folder

#: Where a run that is under way keeps its frames, and where --force puts that of an older run.
CHECKPOINT, _ASIDE = "checkpoint", "checkpoint.old"


@dataclass(frozen=True)
class SimulateOutput:
    """Where the simulation goes and what is printed."""

    out: Path | None = None
    force: bool = False
    resume: bool = False
    formats: str = "html"
    pictures: bool = True
    quiet: bool = False
    as_json: bool = False


def run_simulate(options: SimulateOptions, wanted: SimulateOutput) -> int:
    """The whole command; the exit code.  Raises CommandError for what the user can mend."""
    reporter = SimulationReporter(quiet=wanted.quiet or wanted.as_json)
    formats = output.wanted_formats(wanted.formats)
    if not options.folder.is_dir():
        raise CommandError(f"{options.folder}: no such folder")
    out = wanted.out or _beside(options.folder)
    _check_out(options, out, wanted)
    with reporter.busy("reading"), reading_input():  # long sequences take their time
        plan = read_plan(options)
    remark = output.picture_remark() if wanted.pictures else None
    reporter.plan(plan.scene, summary(plan), [*remarks(plan), *([remark] if remark else [])])
    clock = Clock()
    simulation = _simulated(plan, out, wanted, reporter, clock)
    if not len(simulation.times):
        raise CommandError("interrupted before the first frame", INTERRUPTED)
    record = output.record_of(simulation, settings(plan)) | {"step_seconds": clock.step_seconds}
    with writing_files():
        names = _store(plan, simulation, record, out, reporter)
        shown = output.wanted_files(formats, picture=wanted.pictures and remark is None)
        lost = _show(plan, simulation, out, shown, reporter, names)
    reporter.entry("Files", f"{out}/")
    reporter.line(" " * 12 + "  ".join(names))
    if wanted.as_json:
        print(json.dumps(record, indent=1, allow_nan=False))
    return simulation.status.exit_code or (FAILURE if lost else 0)


def _beside(folder: Path) -> Path:
    place = folder if folder.name not in ("", "..") else folder.resolve()
    return place.parent / f"{place.name}-simulation"


def _check_out(options: SimulateOptions, out: Path, wanted: SimulateOutput) -> None:
    """CommandError for a folder that cannot be used, before any work."""
    if wanted.force and wanted.resume:
        raise CommandError("--resume goes on and --force starts anew: give one of them")
    unfinished = (out / CHECKPOINT).is_dir()
    if wanted.resume and not unfinished:
        raise CommandError(f"--resume: {out} holds no unfinished simulation")
    read = [motion_files(text) for text in (*options.sequences, *options.keyframes)]
    for path in (options.folder, *read):
        place = path.resolve()
        if out.resolve() == place or (path in read and out.resolve() in place.parents):
            raise CommandError(f"--out: {out} holds {path}, which is read: choose another")
    try:
        check_folder(out, overwrite=wanted.force or wanted.resume)
    except FileExistsError as problem:
        hint = "add --resume to go on, --force to start anew" if unfinished else "add --force"
        raise CommandError(f"{problem}: choose another --out or {hint}") from None
    except NotADirectoryError as problem:
        raise CommandError(f"--out: {problem}") from None
    except OSError as problem:
        raise CommandError(f"--out {out}: cannot write there: {problem.strerror}") from None


def _simulated(
    plan: Plan, out: Path, wanted: SimulateOutput, reporter: SimulationReporter, clock: Clock
) -> Simulation:
    """Run with checkpoints.  What an older simulation wrote goes when the first frame is there."""
    kept, aside = out / CHECKPOINT, out / _ASIDE
    if wanted.force and kept.is_dir():
        shutil.rmtree(aside, ignore_errors=True)
        kept.rename(aside)
    try:
        with reporter.following(clock) as live:
            return _go(plan, kept, _watch(out, wanted, clock, live))
    finally:
        if clock.first is None and aside.is_dir() and not kept.exists():
            aside.rename(kept)  # refused: all is as it was


def _watch(
    out: Path, wanted: SimulateOutput, clock: Clock, live: Callable[[Frame], None] | None
) -> Callable[[Frame], None]:
    def watch(frame: Frame) -> None:
        if clock.first is None and wanted.force:
            for path in [*output.owned_paths(out), out / _ASIDE]:
                shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(True)
        clock.tick(frame)
        if live is not None:
            live(frame)

    return watch


def _go(plan: Plan, checkpoint: Path, watch: Callable[[Frame], None]) -> Simulation:
    options = plan.options
    motions: dict[int | str, Motion] = {}
    for number, motion in plan.motions.items():
        motions[number] = motion
    try:
        return simulate(
            plan.result,
            options.seconds,
            problem=plan.scene.problem,
            fps=options.fps,
            substeps=options.substeps,
            rest=options.rest,
            wind=plan.wind,
            motion=motions,
            damping=plan.damping,
            callback=watch,
            checkpoint=checkpoint,
        )
    except ValueError as problem:
        raise CommandError(str(problem)) from problem
    except OSError as problem:
        raise CommandError(f"cannot write: {reason(problem)}", FAILURE) from problem


def _store(
    plan: Plan,
    simulation: Simulation,
    record: Mapping[str, Any],
    out: Path,
    reporter: SimulationReporter,
) -> list[str]:
    """Frames and record, then how it went: nothing is lost by what comes after."""
    output.write_frames(simulation, out)
    output.write_record(record, out / output.RECORD)
    reporter.outcome(record)
    return [output.FRAMES, output.RECORD]


def _show(
    plan: Plan,
    simulation: Simulation,
    out: Path,
    shown: tuple[str, ...],
    reporter: SimulationReporter,
    names: list[str],
) -> bool:
    """Player, films and meshes, added to ``names``; whether one that was asked for is missing.

    An interrupted run gets its player only: nobody waits for the rest.
    """
    scene = plan.scene
    meshed = plan.result.rest if plan.result.natural == "mesh" else None  # a metric has no shape
    shape = meshed if plan.natural else scene.target.vertices
    kind = "natural shape" if plan.natural else "design as natural shape"
    animation = output.animation_of(
        simulation,
        shape,
        scene.obstacles,
        plan.motions,
        name=scene.name,
        title=f"{plan.options.folder.resolve().name}, {kind}",
        up=scene.up_vector,
    )
    interrupted = simulation.status is SimulationStatus.INTERRUPTED
    lost = False
    for name in shown[:1] if interrupted else shown:
        try:
            with reporter.writing(name) as progress:
                names.append(output.write_format(name, animation, out, scene.unit, progress))
        except OSError:
            raise
        # graphics fail in as many ways as there are drivers; the frames are worth more than a film
        except Exception as problem:
            reporter.line(f"no {name}: {problem}", important=True)
            lost |= name != output.PICTURE
    if interrupted and shown[1:]:
        reporter.line(f"note: without {', '.join(shown[1:])}, as it was interrupted")
    if not interrupted:
        shutil.rmtree(out / CHECKPOINT, ignore_errors=True)
    return lost
