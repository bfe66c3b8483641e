"""Pictures and report of a saved result; whatever prevents them is a remark, not a failure."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from casashell.io.results import REPORT_FILE
from casashell.result import Result


def add_artwork(
    result: Result, folder: Path, up: Sequence[float]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Pictures and report.html in ``folder``; names of the files, and what could not be made.

    Files are drawn in a hidden folder first, so none appears half written.
    """
    drawing = folder / f".casashell-{os.urandom(6).hex()}"
    drawing.mkdir()
    try:
        remarks = (*_pictures(result, drawing, up), *_report(result, drawing, up))
        names = sorted(item.name for item in drawing.iterdir() if item.is_file())
        for name in names:
            (drawing / name).replace(folder / name)
    finally:
        shutil.rmtree(drawing, ignore_errors=True)
    return tuple(names), remarks


def _pictures(result: Result, folder: Path, up: Sequence[float]) -> tuple[str, ...]:
    from casashell.io.pictures import PicturesUnavailable, write_pictures

    try:
        write_pictures(result, folder, up=up)
    except (PicturesUnavailable, ValueError, RuntimeError) as problem:
        return (f"no pictures: {problem}",)
    return ()


def _report(result: Result, folder: Path, up: Sequence[float]) -> tuple[str, ...]:
    from casashell.io.report import write_report

    try:
        write_report(result, folder / REPORT_FILE)
    except (ImportError, ValueError) as problem:
        return (f"no report: {problem}",)
    return ()
