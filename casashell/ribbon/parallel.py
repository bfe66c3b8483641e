"""Steps of several ribbons side by side."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TypeVar

Item = TypeVar("Item")
Made = TypeVar("Made")


@dataclass(eq=False)
class Workers:
    """Threads that last as long as a simulation; compiled kernels and linear algebra release the lock.

    count  at most so many; 1, or a single item, runs in the caller
    """

    count: int = field(default_factory=lambda: os.cpu_count() or 1)
    _pool: ThreadPoolExecutor | None = field(default=None, init=False, repr=False)

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None

    def map(self, call: Callable[[Item], Made], items: Sequence[Item]) -> list[Made]:
        """``call`` of every item, in order; the first exception is raised."""
        if self.count <= 1 or len(items) <= 1:
            return [call(item) for item in items]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.count)
        return list(self._pool.map(call, items))
