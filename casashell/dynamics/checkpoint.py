"""Frames on disk while a simulation runs, so that one that was killed goes on where it was.

A folder with ``frames.bin``, records of one frame each that are only ever appended, and ``state.npz``,
replaced in one go every few frames: what is needed to go on behind a frame.  Records behind the last
state are dropped when a run is taken up again.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np

from casashell.typing import AnyArray

_STATE, _FRAMES = "state.npz", "frames.bin"


def fingerprint(arrays: list[AnyArray], texts: list[str]) -> str:
    """Digest of everything a run depends on."""
    made = hashlib.sha256()
    for array in arrays:
        made.update(str((array.dtype.str, array.shape)).encode())
        made.update(np.ascontiguousarray(array).tobytes())
    for text in texts:
        made.update(text.encode())
    return made.hexdigest()


class Checkpoint:
    """The folder of one run.

    Raises ValueError when it holds another run, and OSError for what the file system refuses.
    """

    def __init__(self, folder: str | Path, key: str, record: np.dtype[np.void]) -> None:
        self.folder, self.key, self.record = Path(folder), key, record
        self.folder.mkdir(parents=True, exist_ok=True)
        self._kept = self._stored()
        if self._kept is None and any(self.folder.iterdir()):
            names = {path.name for path in self.folder.iterdir()}
            if not names <= {_FRAMES, _STATE, f"{_STATE}.new"}:
                raise ValueError(
                    f"{self.folder} is not empty and holds no checkpoint: name another"
                )
        frames = 0 if self._kept is None else int(self._kept["frames"])
        path = self.folder / _FRAMES
        path.touch()
        os.truncate(path, frames * record.itemsize)

    def _stored(self) -> dict[str, AnyArray] | None:
        path = self.folder / _STATE
        if not path.is_file():
            return None
        try:
            with np.load(path, allow_pickle=False) as file:
                stored = {name: file[name] for name in file.files}
        except (OSError, ValueError) as error:
            raise ValueError(f"{path} cannot be read: {error}; delete it to start anew") from None
        if str(stored.get("key")) != self.key:
            raise ValueError(
                f"{self.folder} holds the checkpoint of another simulation (other shell, material, "
                "start, obstacles, wind or step): name another folder or delete it"
            )
        size = (self.folder / _FRAMES).stat().st_size if (self.folder / _FRAMES).is_file() else 0
        if size < int(stored["frames"]) * self.record.itemsize:
            raise ValueError(f"{self.folder / _FRAMES} is shorter than {path} says: delete both")
        return stored

    def resume(self) -> tuple[dict[str, AnyArray], AnyArray] | None:
        """The state last saved and the frames before it, or None for a new run."""
        if self._kept is None:
            return None
        return self._kept, np.fromfile(self.folder / _FRAMES, dtype=self.record)

    def append(self, frame: AnyArray) -> None:
        """Add the record of a frame."""
        with (self.folder / _FRAMES).open("ab") as file:
            file.write(frame.tobytes())

    def save(self, frames: int, state: dict[str, AnyArray]) -> None:
        """Replace the state by that behind frame number ``frames`` - 1."""
        fresh = self.folder / f"{_STATE}.new"
        with fresh.open("wb") as file:
            ends = {"key": np.array(self.key), "frames": np.array(frames)}
            np.savez(file, allow_pickle=False, **ends, **state)
        os.replace(fresh, self.folder / _STATE)
