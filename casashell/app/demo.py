"""`casashell demo`: two built-in scenes, solved, drawn and explained."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from casashell.app.builtin import BUILTIN
from casashell.app.display import Reporter
from casashell.app.failures import CommandError
from casashell.app.invert import Clock, OutputOptions, solve_scene, store
from casashell.contact.detect import describe
from casashell.io.staging import check_folder

SCENES: Final = ("hat", "skirt")

_PROOF = """
What this shows: laid on its obstacle in the designed pose, a shell made with the natural shape
stays exactly there under its own weight, held by friction alone.  A shell made in the designed
shape itself would sag.  The certificate above was computed from the two shapes by code that shares
nothing with the solver."""


def run_demo(out: Path, *, force: bool, pictures: bool, quiet: bool) -> int:
    """Solve the scenes into folders under ``out``; the worst exit code."""
    for name in SCENES:
        try:
            check_folder(out / name, overwrite=force)
        except FileExistsError as problem:
            raise CommandError(f"{problem}: choose another --out or add --force") from None
        except OSError as problem:
            raise CommandError(f"--out {out}: cannot write there: {problem}") from None
    reporter = Reporter(quiet=quiet)
    output = OutputOptions(force=force, pictures=pictures, quiet=quiet)
    codes = []
    for name in SCENES:
        clock = Clock()
        scene = BUILTIN[name]()
        reporter.line(f"--- {name} ---")
        reporter.scene(scene, describe(scene.problem.contacts, scene.obstacles))
        result = solve_scene(scene, reporter)
        clock.lap("solve")
        store(scene, result, out / name, output, reporter, clock)
        reporter.line()
        codes.append(result.status.exit_code)
    if not any(codes):
        reporter.line(_PROOF.strip())
    for name in SCENES:
        where = "report.html" if (out / name / "report.html").is_file() else "natural.obj"
        reporter.line(f"Look at {out / name / where}")
    reporter.line(f"Solve again with: casashell invert {out / SCENES[0] / 'scene.toml'}")
    return max(codes)
