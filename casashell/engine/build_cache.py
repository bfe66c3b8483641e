"""Compile C sources into shared libraries, once per machine.

An entry is a pointer file ``KEY.json`` that names a library file and its SHA-256.  Both are written
under a temporary name and renamed, the pointer last, so that processes that compile at once never
see half an entry.  A library is loaded only when it belongs to this user, cannot be written by
others and still has the digest of its pointer; anything else is rebuilt.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import platform
import shutil
import stat
import subprocess
import tempfile
from functools import cache
from pathlib import Path

FLAGS = ("-O2", "-march=native", "-fPIC", "-shared", "-w", "-fno-math-errno")


class CompilerError(RuntimeError):
    """The system compiler is missing or refused generated code."""


@cache
def find_compiler() -> str | None:
    """Path of the C compiler: ``$CC``, else cc, gcc or clang; None when there is none."""
    wanted = os.environ.get("CASASHELL_CC", os.environ.get("CC", ""))
    if wanted.lower() == "none":
        return None
    for name in (wanted, "cc", "gcc", "clang"):
        path = shutil.which(name) if name else None
        if path:
            return path
    return None


def cache_directory() -> Path:
    """Where libraries are kept: ``$CASASHELL_CACHE``, else the user's cache directory."""
    chosen = os.environ.get("CASASHELL_CACHE")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "casashell"
    except RuntimeError:  # no home directory at all
        return Path(tempfile.gettempdir()) / f"casashell-{os.getuid()}"


@cache
def _cpu() -> str:
    """What -march=native depends on."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = info.read_text(errors="replace").splitlines()
        wanted = ("flags", "Features", "model name", "CPU part")
        return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))
    return platform.processor()


@cache
def toolchain() -> str:
    """Text that changes when a cached library must not be used any more."""
    compiler = find_compiler()
    if compiler is None:
        return "none"
    real = Path(compiler).resolve()
    size = real.stat()
    return "|".join(
        (str(real), str(size.st_size), str(size.st_mtime_ns), *FLAGS, platform.machine(), _cpu())
    )


def _is_private(path: Path) -> bool:
    """Regular file of this user that nobody else may write."""
    info = path.lstat()
    mine = not hasattr(os, "getuid") or info.st_uid == os.getuid()
    return stat.S_ISREG(info.st_mode) and mine and not info.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _lookup(folder: Path, key: str) -> Path | None:
    pointer = folder / f"{key}.json"
    try:
        entry = json.loads(pointer.read_text())
        name, digest = str(entry["library"]), str(entry["sha256"])
        library = folder / name
        if Path(name).name != name or not (_is_private(pointer) and _is_private(library)):
            return None
        if hashlib.sha256(library.read_bytes()).hexdigest() != digest:
            return None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return library


def _writable(folder: Path) -> Path:
    """``folder``, created for this user alone; a fresh temporary folder when that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return _own_folder()


@cache
def _own_folder() -> Path:
    """A folder of this process alone, removed when it ends."""
    folder = tempfile.mkdtemp(prefix="casashell-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _compile(source: str, folder: Path, key: str) -> Path:
    compiler = find_compiler()
    if compiler is None:
        raise CompilerError("no C compiler found")
    with tempfile.TemporaryDirectory(dir=folder, prefix="build-") as work:
        code, built = Path(work) / "kernel.c", Path(work) / "kernel.so"
        code.write_text(source)
        command = [compiler, *FLAGS, str(code), "-o", str(built), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise CompilerError(f"{compiler} failed: {done.stderr.strip()[:500]}")
        digest = hashlib.sha256(built.read_bytes()).hexdigest()
        library = folder / f"{key}-{digest[:16]}.so"
        built.chmod(0o700)
        built.replace(library)
        pointer = Path(work) / "pointer.json"
        pointer.write_text(json.dumps({"library": library.name, "sha256": digest}))
        pointer.chmod(0o600)
        pointer.replace(folder / f"{key}.json")
    return library


def cached_library(key: str) -> Path | None:
    """Library stored under ``key`` on this machine, or None."""
    return _lookup(cache_directory(), key)


def build_library(key: str, source: str) -> Path:
    """Compile ``source`` and store it under ``key``.

    Raises CompilerError when there is no compiler or it fails.
    """
    return _compile(source, _writable(cache_directory()), key)
