"""Compiled kernels on disk: what is loaded, what is rebuilt, and what happens without a compiler."""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from casashell.engine import build_cache
from casashell.engine.kernels import get_kernel

ROOT = Path(__file__).resolve().parents[2]
SOURCE = "int answer(void) {{ return {0}; }}\n"
needs_compiler = pytest.mark.skipif(
    build_cache.find_compiler() is None, reason="no C compiler on this machine"
)

# Builds the shell on two triangles and asks for what is named on the command line.
SCRIPT = """
import sys
import numpy as np
from casashell.engine.assembly import Assembly
from casashell.mesh import TriMesh
from formulations import discrete_shell

mesh = TriMesh(
    np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.2]]), np.array([[0, 1, 2], [2, 1, 3]])
)
shell = discrete_shell(mesh, density=0.2, stretch=20.0, bend=1e-3)
assembly = Assembly(shell, 4)
x = mesh.vertices * 1.1
for name in sys.argv[1:]:
    getattr(assembly, name)(x, mesh.vertices)
print(assembly.compiled, np.abs(assembly.gradient(x, mesh.vertices)).sum())
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache that this process uses."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("CASASHELL_CACHE", str(folder))
    return folder


def _start(cache: Path, *kernels: str, **environment: str) -> subprocess.Popen[str]:
    settings = {**os.environ, "CASASHELL_CACHE": str(cache), "PYTHONPATH": str(ROOT), **environment}
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", SCRIPT, *kernels],
        env=settings,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _result(process: subprocess.Popen[str]) -> tuple[bool, float]:
    """(compiled, sum of forces) that the script printed."""
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    compiled, total = out.split()
    return compiled == "True", float(total)


def _answer(library: Path) -> int:
    return int(ctypes.CDLL(str(library)).answer())


def _pointer(cache: Path, key: str = "k") -> Path:
    return cache / f"{key}.json"


@needs_compiler
def test_library_is_built_once_and_found_again(cache: Path) -> None:
    assert build_cache.cached_library("k") is None
    built = build_cache.build_library("k", SOURCE.format(41))
    assert built.parent == cache
    assert _answer(built) == 41
    assert build_cache.cached_library("k") == built
    assert build_cache.cached_library("other") is None
    assert sorted(p.suffix for p in cache.iterdir()) == [".json", ".so"]  # no leftovers
    for path in (built, _pointer(cache)):
        assert path.stat().st_mode & 0o077 == 0
    assert cache.stat().st_mode & 0o077 == 0


@needs_compiler
def test_corrupt_library_is_not_loaded(cache: Path) -> None:
    built = build_cache.build_library("k", SOURCE.format(42))
    data = bytearray(built.read_bytes())
    data[len(data) // 2] ^= 0xFF
    built.write_bytes(data)
    assert build_cache.cached_library("k") is None
    assert _answer(build_cache.build_library("k", SOURCE.format(42))) == 42
    assert build_cache.cached_library("k") is not None


@needs_compiler
@pytest.mark.parametrize(
    "text",
    ["", "{", '{"library": "k', "[]", "null", '{"library": "x.so"}', '{"library": 3, "sha256": 4}'],
)
def test_unreadable_pointer_is_not_followed(cache: Path, text: str) -> None:
    build_cache.build_library("k", SOURCE.format(43))
    _pointer(cache).write_text(text)
    assert build_cache.cached_library("k") is None


@needs_compiler
def test_missing_library_is_rebuilt(cache: Path) -> None:
    build_cache.build_library("k", SOURCE.format(44)).unlink()
    assert build_cache.cached_library("k") is None
    assert _answer(build_cache.build_library("k", SOURCE.format(44))) == 44


@needs_compiler
@pytest.mark.parametrize("which", ["library", "pointer"])
@pytest.mark.parametrize("mode", [0o702, 0o720, 0o777])
def test_file_others_may_write_is_not_trusted(cache: Path, which: str, mode: int) -> None:
    built = build_cache.build_library("k", SOURCE.format(45))
    (built if which == "library" else _pointer(cache)).chmod(mode)
    assert build_cache.cached_library("k") is None
    build_cache.build_library("k", SOURCE.format(45))
    assert build_cache.cached_library("k") == built


@needs_compiler
@pytest.mark.parametrize("which", ["library", "pointer"])
def test_file_of_another_user_is_not_trusted(
    cache: Path, which: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = build_cache.build_library("k", SOURCE.format(46))
    path = built if which == "library" else _pointer(cache)
    if os.getuid() == 0:
        os.chown(path, 12345, -1)
    else:
        someone = os.getuid() + 1
        monkeypatch.setattr(os, "getuid", lambda: someone)
    assert build_cache.cached_library("k") is None


@needs_compiler
def test_pointer_out_of_the_folder_is_not_followed(cache: Path, tmp_path: Path) -> None:
    """Not even to a sound library with the right digest; nor through a symbolic link."""
    built = build_cache.build_library("k", SOURCE.format(47))
    entry = json.loads(_pointer(cache).read_text())
    outside = tmp_path / "outside.so"
    built.replace(outside)
    _pointer(cache).write_text(json.dumps({**entry, "library": "../outside.so"}))
    assert build_cache.cached_library("k") is None
    _pointer(cache).write_text(json.dumps(entry))
    built.symlink_to(outside)
    assert build_cache.cached_library("k") is None


@needs_compiler
def test_refused_source_is_an_error_and_leaves_nothing(cache: Path) -> None:
    with pytest.raises(build_cache.CompilerError, match="failed"):
        build_cache.build_library("k", "this is not C\n")
    assert list(cache.iterdir()) == []


@needs_compiler
def test_only_the_kernels_asked_for_are_built(tmp_path: Path) -> None:
    """Three terms: three gradients; a Hessian adds three; nothing else is compiled."""
    assert _result(_start(tmp_path))[0]
    kinds = sorted(p.name.rsplit("-", 1)[0] for p in tmp_path.glob("*.json"))
    gradients = ["area_gravity-gradient", "edge_stretch-gradient", "hinge_bending-gradient"]
    assert kinds == gradients
    ages = {p: p.stat().st_mtime_ns for p in tmp_path.glob("*.so")}
    assert _result(_start(tmp_path, "energy"))[0]
    both = {p.name.rsplit("-", 1)[0] for p in tmp_path.glob("*.json")}
    assert both == {*gradients, *(name.replace("gradient", "energy") for name in gradients)}
    assert all(p.stat().st_mtime_ns == age for p, age in ages.items())  # not compiled again


@needs_compiler
def test_two_processes_fill_an_empty_cache_at_once(tmp_path: Path) -> None:
    running = [_start(tmp_path, "energy") for _ in range(2)]
    results = [_result(process) for process in running]
    assert results[0] == results[1]
    assert results[0][0]
    assert len(list(tmp_path.glob("*.json"))) == 6
    assert {p.suffix for p in tmp_path.iterdir()} == {".json", ".so"}
    assert _result(_start(tmp_path)) == results[0]


@needs_compiler
def test_spoiled_kernels_are_rebuilt_not_loaded(tmp_path: Path) -> None:
    """Loading any of these files would end the process or give other forces."""
    wanted = _result(_start(tmp_path))
    libraries = sorted(tmp_path.glob("*.so"))
    libraries[0].write_bytes(b"\x7fELF and then nothing")
    libraries[1].write_bytes(libraries[2].read_bytes())
    pointers = sorted(tmp_path.glob("*.json"))
    pointers[2].write_text(pointers[2].read_text()[:20])
    assert _result(_start(tmp_path)) == wanted


@needs_compiler
@pytest.mark.parametrize("folder", ["/dev/null/cache", "/proc/cache"])
def test_cache_that_cannot_be_written_still_serves(folder: str, tmp_path: Path) -> None:
    if not Path(folder).parent.exists():
        pytest.skip(f"{folder} means nothing on this system")
    wanted = _result(_start(tmp_path / "cache"))
    (tmp_path / "scratch").mkdir()
    found = _result(_start(Path(folder), TMPDIR=str(tmp_path / "scratch")))
    assert found == wanted


@pytest.mark.parametrize("compiler", ["none", "false"])
def test_without_a_working_compiler_kernels_are_interpreted(tmp_path: Path, compiler: str) -> None:
    """``none`` switches compilation off; ``false`` is a program that always fails."""
    compiled, total = _result(
        _start(tmp_path / "cache", CASASHELL_CC=compiler, PATH=os.environ["PATH"])
    )
    assert not compiled
    _, wanted = _result(_start(tmp_path / "other"))
    assert total == pytest.approx(wanted, rel=1e-12)


def test_change_of_the_density_changes_the_kernel(cache: Path) -> None:
    """Same name, other formula: the cache must tell them apart."""
    for factor in (3.0, 5.0):
        x, r, p = ca.SX.sym("x", 3, 1), ca.SX.sym("r", 3, 1), ca.SX.sym("p", 1)
        density = ca.Function("twin", [x, r, p], [factor * p[0] * x[2]])
        kernel = get_kernel(density, "gradient")
        points = np.zeros((1, 3))
        (force,) = kernel(points, points, np.ones((1, 1)), np.zeros((1, 1), dtype=np.int64), points)
        assert force.tolist() == [[0.0, 0.0, factor]]
        assert get_kernel(density, "gradient") is kernel


def test_cache_directory_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CASASHELL_CACHE", "/some/where")
    assert build_cache.cache_directory() == Path("/some/where")
    monkeypatch.delenv("CASASHELL_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/users/cache")
    assert build_cache.cache_directory() == Path("/users/cache/casashell")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/someone")
    assert build_cache.cache_directory() == Path("/home/someone/.cache/casashell")
