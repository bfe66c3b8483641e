"""Report and pictures of a saved result; whatever prevents them is a remark, not a failure."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from casashell.io.results import REPORT_FILE
from casashell.result import Result


def add_report(result: Result, folder: Path, title: str, up: Sequence[float]) -> tuple[str, ...]:
    """Write report.html into ``folder``; the names of the files."""
    from casashell.io.report import write_report

    with _drawn_aside(folder) as aside:
        write_report(result, aside / REPORT_FILE, title=title, up=up)
    return (REPORT_FILE,)


def add_pictures(
    result: Result, folder: Path, up: Sequence[float]
) -> tuple[tuple[str, ...], str | None]:
    """Write the pictures into ``folder``; the names of the files, and why there are none."""
    from casashell.io.pictures import write_pictures

    try:
        with _drawn_aside(folder) as aside:
            paths = write_pictures(result, aside, up=up)
    # graphics fail in as many ways as there are drivers; the result is worth more than its picture
    except Exception as problem:
        return (), f"no pictures: {problem}"
    return tuple(sorted(path.name for path in paths)), None


@contextmanager
def _drawn_aside(folder: Path) -> Iterator[Path]:
    """A hidden folder whose files are moved to ``folder`` when complete."""
    aside = folder / f".casashell-{os.urandom(6).hex()}"
    aside.mkdir()
    try:
        yield aside
        for item in aside.iterdir():
            item.replace(folder / item.name)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
