"""`casashell view`: the report of a result in the browser."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from casashell.app.artwork import add_report
from casashell.app.failures import CommandError, reading_input, writing_files
from casashell.io.results import REPORT_FILE, load_result


def run_view(folder: Path, *, print_only: bool) -> int:
    """Open the report, or print where it is when there is no screen; the exit code.

    A missing report is made again from the saved result.
    """
    report = folder / REPORT_FILE
    if not folder.is_dir():
        raise CommandError(f"{folder}: no such folder")
    if not report.is_file():
        with reading_input():
            result = load_result(folder)
        gravity = result.material.get("gravity")
        up = (0.0, 1.0, 0.0) if gravity is None or not gravity.any() else tuple(-gravity)
        with writing_files():
            add_report(result, folder, folder.resolve().name, up)
    if print_only or _headless() or not _opened(report):
        print(report)
    return 0


def _headless() -> bool:
    """No screen to open a browser on."""
    if sys.platform in ("win32", "darwin"):
        return False
    return not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _opened(report: Path) -> bool:
    import webbrowser

    return webbrowser.open(report.resolve().as_uri())
