"""Folders that appear complete or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


def check_folder(folder: Path, *, overwrite: bool) -> None:
    """Raise unless ``folder`` can be written: before any work, so that none is lost.

    FileExistsError: it holds files and ``overwrite`` is False.  NotADirectoryError: a file is in
    the way.  OSError: the file system refuses (tried out, nothing is left behind).
    """
    if folder.is_dir() and not overwrite and any(folder.iterdir()):
        raise FileExistsError(f"{folder} exists and is not empty")
    for place in (folder, *folder.parents):
        if not place.is_dir() and (place.exists() or place.is_symlink()):
            raise NotADirectoryError(f"{place} is a file, not a folder")
    with _temporary(folder):
        pass


@contextmanager
def staged(
    folder: Path, *, overwrite: bool, owned: Callable[[str], bool], last: str
) -> Iterator[Path]:
    """A temporary folder whose files are put into ``folder`` when the block ends well.

    A new folder appears by one rename.  In an existing one, files whose names are ``owned`` are
    replaced or, when there is no new one, removed; others stay.  The file ``last`` is taken away
    first and put back last, so that a folder that has it is complete.

    Raises what `check_folder` raises; on any error ``folder`` is as it was.
    """
    check_folder(folder, overwrite=overwrite)
    with _temporary(folder) as temporary:
        yield temporary
        if folder.is_dir() and any(item != temporary for item in folder.iterdir()):
            _replace_files(temporary, folder, owned, last)
        elif folder.is_dir():  # empty: filled in place, for it may be somebody's working folder
            _move_files(temporary, folder, last)
        else:
            folder.parent.mkdir(parents=True, exist_ok=True)
            temporary.rename(folder)


def _replace_files(source: Path, folder: Path, owned: Callable[[str], bool], last: str) -> None:
    (folder / last).unlink(missing_ok=True)
    for item in folder.iterdir():
        if item.is_file() and owned(item.name) and not (source / item.name).exists():
            item.unlink()
    _move_files(source, folder, last)


def _move_files(source: Path, folder: Path, last: str) -> None:
    for item in sorted(source.iterdir(), key=lambda item: (item.name == last, item.name)):
        item.replace(folder / item.name)


@contextmanager
def _temporary(folder: Path) -> Iterator[Path]:
    """A new hidden folder on the file system of ``folder``, gone afterwards."""
    base = folder
    while not base.is_dir():
        base = base.parent
    path = base / f".casashell-{os.urandom(6).hex()}"
    path.mkdir()
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)


@contextmanager
def staged_file(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """A name beside ``path``, with its suffix, that takes its place when the block ends well.

    FileExistsError: ``path`` is there and ``overwrite`` is False.  NotADirectoryError: a file is in
    the way.  On any error ``path`` is as it was.
    """
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder, not a file")
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists")
    check_folder(path.parent, overwrite=True)
    with _temporary(path.parent) as temporary:
        written = temporary / path.name
        yield written
        path.parent.mkdir(parents=True, exist_ok=True)
        written.replace(path)
