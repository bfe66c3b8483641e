"""A small memory of index arrays that depend on topology alone, shared by all calls of a process."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Final, Generic, TypeVar

from casashell.typing import AnyArray

T = TypeVar("T")

#: How much one memory keeps: entries, and bytes of all of them.
ENTRIES: Final = 8
BYTES: Final = 256 * 1024**2


class Recent(Generic[T]):
    """The last few values made, by key; the one that was not asked for longest goes first.

    Values are shared between threads and calls, so they must not change: see `frozen`.  Two threads
    that ask for the same new key at once may both make it; either value is right.
    """

    def __init__(self, entries: int = ENTRIES, limit: int = BYTES) -> None:
        self.entries, self.limit = entries, limit
        self._kept: OrderedDict[bytes, tuple[T, int]] = OrderedDict()
        self._lock = Lock()

    def get(self, key: bytes, make: Callable[[], T], size: Callable[[T], int]) -> T:
        """The value kept under ``key``, else ``make()``; ``size`` gives its bytes.

        A value beyond the limit is returned and not kept.
        """
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key][0]
        value = make()
        with self._lock:
            self._kept[key] = value, size(value)
            self._kept.move_to_end(key)
            while len(self._kept) > self.entries or self.nbytes > self.limit:
                self._kept.popitem(last=False)
        return value

    def clear(self) -> None:
        """Forget everything."""
        with self._lock:
            self._kept.clear()

    @property
    def nbytes(self) -> int:
        """Bytes of all values kept."""
        return sum(size for _, size in self._kept.values())

    def __len__(self) -> int:
        return len(self._kept)


def digest(*parts: AnyArray | bytes | int) -> bytes:
    """Key of arrays with their shapes and types, of bytes and of whole numbers."""
    made = hashlib.blake2b(digest_size=16)
    for part in parts:
        if isinstance(part, bytes | int):
            made.update(repr(part).encode() + b";")
        else:
            made.update(f"{part.dtype.str}{part.shape};".encode())
            made.update(part.tobytes())
    return made.digest()


def frozen(array: AnyArray) -> AnyArray:
    """The array itself, from now on read-only."""
    array.flags.writeable = False
    return array
