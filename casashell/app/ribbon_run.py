"""`casashell ribbon`: a scene of ribbons, moved through time and written to a folder."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from casashell.app import ribbon_output as output
from casashell.app.failures import (
    FAILURE,
    INTERRUPTED,
    CommandError,
    reading_input,
    reason,
    writing_files,
)
from casashell.app.ribbon_display import RibbonReporter
from casashell.app.ribbon_measures import record_of, settings_of
from casashell.app.ribbon_setup import RibbonSetup
from casashell.app.simulate_output import (
    wanted_formats,
    write_format,
    write_frames,
    write_record,
)
from casashell.io.staging import check_folder
from casashell.ribbon.dynamics import simulate
from casashell.ribbon.record import Progress, RibbonSimulation, RunStatus

#: Folder of a run that is under way: the frames so far, and what they are frames of.
CHECKPOINT: Final = "checkpoint"
_KEPT, _SETTINGS = "ribbons.npz", "settings.json"
#: Steps between checkpoints.
_EVERY: Final = 10
_EXIT: Final = {
    RunStatus.COMPLETE: 0,
    RunStatus.FAILED: FAILURE,
    RunStatus.INTERRUPTED: INTERRUPTED,
}


@dataclass(frozen=True)
class RibbonOptions:
    """The command line as typed; None where not given."""

    scene: str
    out: Path | None = None
    seconds: float | None = None
    step: float | None = None
    solver: str | None = None
    formats: str = "html"
    force: bool = False
    resume: bool = False
    quiet: bool = False
    as_json: bool = False


def run_ribbon(options: RibbonOptions) -> int:
    """The whole command; the exit code.  Raises CommandError for what the user can mend."""
    reporter = RibbonReporter(quiet=options.quiet or options.as_json)
    formats = wanted_formats(options.formats)
    with reading_input():
        setup = read_setup(options)
    out = options.out or Path(f"{Path(options.scene).stem}-ribbon")
    _check_out(out, setup, options)
    reporter.setup(setup)
    begin = time.perf_counter()
    simulation = _simulated(setup, out, options, reporter)
    record = record_of(setup, simulation, time.perf_counter() - begin)
    with writing_files():
        write_frames(simulation, out)
        write_record(record, out / output.RECORD)
        reporter.ended(record)
        names = [output.FRAMES, output.RECORD]
        names += _written(setup, simulation, out, formats, reporter)
    reporter.line()
    reporter.entry("Files", f"{out}/")
    reporter.line(" " * 12 + "  ".join(names))
    if options.as_json:
        print(json.dumps(record, indent=1, allow_nan=False))
    return _EXIT[simulation.status]


def read_setup(options: RibbonOptions) -> RibbonSetup:
    """The scene with the options over it.  ValueError for what cannot work, before any step."""
    path = Path(options.scene)
    if path.suffix.lower() == ".toml":
        from casashell.app.ribbon_reader import read_ribbon_scene

        setup = read_ribbon_scene(path)
    else:
        from casashell.app.ribbon_scenes import builtin_setup

        setup = builtin_setup(options.scene)
    if options.solver is not None:
        if options.solver not in ("augmented", "ipopt"):
            raise ValueError(f"--solver must be augmented or ipopt, got '{options.solver}'")
        solver: Any = options.solver
        setup = replace(setup, solver=solver)
    setup = setup.with_times(options.seconds, options.step)
    setup.require_possible()
    return setup


def _check_out(out: Path, setup: RibbonSetup, options: RibbonOptions) -> None:
    """CommandError for a folder that cannot be used, and for a checkpoint of something else."""
    if options.force and options.resume:
        raise CommandError("--resume goes on and --force starts anew: give one of them")
    kept = out / CHECKPOINT / _KEPT
    if options.resume and not kept.is_file():
        raise CommandError(f"--resume: {out} holds no unfinished run")
    if options.resume:
        _check_same(kept.with_name(_SETTINGS), setup)
    scene = Path(options.scene)
    if options.force and scene.suffix == ".toml" and out.resolve() in scene.resolve().parents:
        for path in output.owned_paths(out):
            if path.resolve() in (scene.resolve(), *scene.resolve().parents):
                raise CommandError(f"--force would remove {scene}: choose another --out")
    try:
        check_folder(out, overwrite=options.force or options.resume)
    except FileExistsError as problem:
        hint = "add --resume to go on, --force to start anew" if kept.is_file() else "add --force"
        raise CommandError(f"{problem}: choose another --out or {hint}") from None
    except OSError as problem:
        raise CommandError(f"--out {out}: cannot write there: {reason(problem)}") from None


def _identity(setup: RibbonSetup) -> dict[str, Any]:
    return {"scene": setup.source, **settings_of(setup)}


def _check_same(path: Path, setup: RibbonSetup) -> None:
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise CommandError(f"--resume: {path} cannot be read; start anew with --force") from None
    for key, value in _identity(setup).items():
        if kept.get(key) != value:
            what = "is of another scene" if key == "scene" else f"has {key} {kept.get(key)}"
            raise CommandError(
                f"--resume: the unfinished run {what}; give the same scene and options, or --force"
            )


def _simulated(
    setup: RibbonSetup, out: Path, options: RibbonOptions, reporter: RibbonReporter
) -> RibbonSimulation:
    """Run with checkpoints."""
    kept = out / CHECKPOINT / _KEPT
    try:
        if not options.resume:
            _begin(setup, out)
        with reporter.stepping() as live:
            return simulate(
                setup.scene,
                setup.seconds,
                setup.step,
                solver=setup.solver,
                resample=setup.resample,
                mass=setup.mass,
                form=setup.form,
                callback=_told(live),
                checkpoint=kept,
                every=_EVERY,
                resume=options.resume,
            )
    except ValueError as problem:
        raise CommandError(str(problem)) from problem
    except OSError as problem:
        raise CommandError(f"cannot write: {reason(problem)}", FAILURE) from problem


def _told(live: Callable[[Progress], None] | None) -> Callable[[Progress], None] | None:
    if live is None:
        return None

    def told(progress: Progress) -> None:
        live(progress)

    return told


def _begin(setup: RibbonSetup, out: Path) -> None:
    """Clear the folder of an older run and say what this one is of."""
    for path in [*output.owned_paths(out), out / CHECKPOINT]:
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    place = out / CHECKPOINT
    place.mkdir(parents=True)
    text = json.dumps(_identity(setup), indent=1)
    (place / _SETTINGS).write_text(text + "\n", encoding="utf-8")


def _written(
    setup: RibbonSetup,
    simulation: RibbonSimulation,
    out: Path,
    formats: tuple[str, ...],
    reporter: RibbonReporter,
) -> list[str]:
    """Player and formats; nobody waits for the latter after an interrupt."""
    animation, names = output.animation_of(setup, simulation), []
    interrupted = simulation.status is RunStatus.INTERRUPTED
    for name in dict.fromkeys(("html", *(() if interrupted else formats))):
        with reporter.writing(name) as progress:
            names.append(write_format(name, animation, out, 1.0, progress))
    left = [name for name in formats if name != "html"]
    if interrupted and left:
        reporter.line(f"note: {', '.join(left)} not written: interrupted")
    if not interrupted:
        shutil.rmtree(out / CHECKPOINT, ignore_errors=True)
    return names


def list_scenes(*, as_json: bool) -> None:
    """Print the built-in scenes."""
    from casashell.app.ribbon_scenes import SCENES

    if as_json:
        rows: list[Mapping[str, Any]] = [
            {
                "name": name,
                "about": scene.about,
                "size": scene.size,
                "seconds": scene.seconds,
                "step": scene.step,
                "work_per_second": scene.work,
            }
            for name, scene in SCENES.items()
        ]
        print(json.dumps(rows, indent=1))
        return
    for name, scene in SCENES.items():
        steps = round(scene.seconds / scene.step)
        print(f"{name:<15}{scene.about}")
        print(
            f"{'':<15}{scene.size}; {scene.seconds:g} s in {steps} steps of {scene.step:g} s; "
            f"a second takes about {scene.work:g} s"
        )
