"""The memory of patterns: bounded, keyed by topology alone, and never changed by its users."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from meshes import grid
from small_scenes import clamped_page, hat_on_ball

from casashell.engine.assembly import Assembly
from casashell.engine.recent import Recent, digest
from casashell.inverse.load_path import LoadPath
from casashell.inverse.piece import split
from casashell.problem import Problem
from casashell.typing import FloatArray
from formulations import discrete_shell


def _path(problem: Problem) -> LoadPath:
    return LoadPath(next(split(problem)), lambda step: None)


def test_the_one_not_asked_for_longest_is_forgotten() -> None:
    made: list[bytes] = []
    memory: Recent[bytes] = Recent(entries=2)

    def ask(key: bytes) -> None:
        memory.get(key, lambda: made.append(key) or key, len)  # type: ignore[func-returns-value]

    for key in (b"a", b"b", b"a", b"c", b"a", b"b"):
        ask(key)
    assert made == [b"a", b"b", b"c", b"b"]
    assert len(memory) == 2
    memory.clear()
    assert (len(memory), memory.nbytes) == (0, 0)


def test_values_beyond_the_limit_are_not_kept() -> None:
    memory: Recent[FloatArray] = Recent(limit=100)
    small, large = np.zeros(8), np.zeros(20)
    assert memory.get(b"small", lambda: small, lambda a: a.nbytes) is small
    assert memory.get(b"large", lambda: large, lambda a: a.nbytes) is large
    assert memory.nbytes <= 100


def test_many_threads_get_what_they_asked_for() -> None:
    memory: Recent[int] = Recent(entries=3)

    def ask(number: int) -> int:
        return memory.get(digest(number % 7), lambda: number % 7, lambda _: 8)

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(ask, range(400))) == [n % 7 for n in range(400)]
    assert len(memory) == 3


def test_keys_tell_shapes_types_and_borders_apart() -> None:
    line = np.arange(4)
    keys = {
        digest(line),
        digest(line.reshape(2, 2)),
        digest(line.astype(np.int32)),
        digest(line[:2], line[2:]),
        digest(4, line),
        digest(b"4", line),
    }
    assert len(keys) == 6


def test_another_material_finds_the_pattern_again() -> None:
    mesh = grid(4, 3)
    count = len(mesh.vertices)
    soft, stiff = (
        Assembly(discrete_shell(mesh, density=0.2, stretch=20.0, bend=bend), count)
        for bend in (1e-3, 2.0)
    )
    without = Assembly(discrete_shell(mesh, density=0.2, stretch=20.0, bend=0.0), count)
    assert soft.pattern is stiff.pattern
    assert without.pattern is not soft.pattern
    assert without.pattern.nnz < soft.pattern.nnz
    for one, other in zip(soft.energies, stiff.energies, strict=True):
        assert soft.scatter_map(one) is stiff.scatter_map(other)
        with pytest.raises(ValueError, match="read-only"):
            soft.scatter_map(one)[0, 0] = 1


def test_the_bordered_pattern_follows_pins_and_contacts() -> None:
    page = clamped_page()
    fewer = Problem(page.target, page.energies, pinned=range(7))
    paths = [_path(problem) for problem in (page, clamped_page(bend=1.0), fewer)]
    assert paths[0]._bordered is paths[1]._bordered
    assert paths[2]._bordered is not paths[0]._bordered
    hat = hat_on_ball()
    tight = Problem(hat.target, hat.energies, hat.obstacles, contact_tolerance=1e-6)
    assert len(tight.contacts) < len(hat.contacts)
    assert _path(tight)._bordered is not _path(hat)._bordered
