"""Runs of other Pythons and of `casashell simulate`, each a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.peers.scenes import FPS, Arrays
from casashell.typing import FloatArray

HERE: Final = Path(__file__).resolve().parent
SCRIPTS: Final = {"blender": HERE / "blender_cloth.py", "newton": HERE / "newton_vbd.py"}


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Positions (F,V,3) m at times (F,) s, and the wall time of a frame."""

    times: FloatArray
    positions: FloatArray
    frame_seconds: float
    version: str

    @staticmethod
    def read(path: Path) -> Trajectory:
        """What a script wrote."""
        with np.load(path, allow_pickle=False) as file:
            taken = float(file["seconds"]) / max(int(file["frames"]), 1)
            return Trajectory(file["times"], file["positions"], taken, str(file["version"]))

    def until(self, seconds: float) -> Trajectory:
        """The part up to a time."""
        kept = self.times <= seconds + 0.5 / FPS
        return Trajectory(self.times[kept], self.positions[kept], self.frame_seconds, self.version)


def checked_python(option: str, path: Path, module: str) -> Path:
    """Raises ValueError for a path that is no Python with ``module``."""
    if not path.is_file():
        raise ValueError(f"{option}: {path} is no file; give the python of an environment")
    seen = "import importlib.util as u, sys; sys.exit(u.find_spec(sys.argv[1]) is None)"
    try:
        found = subprocess.run([path, "-c", seen, module], capture_output=True, check=False)
    except OSError as problem:
        raise ValueError(f"{option}: {path} cannot be run: {problem}") from problem
    if found.returncode:
        raise ValueError(f"{option}: {path} has no {module}: {path} -m pip install {module}")
    return path


def run_script(python: Path, peer: str, arrays: Arrays, out: Path | None = None) -> Trajectory:
    """One run of a peer; kept in ``out`` if given.  Raises RuntimeError with what it printed last."""
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(given, allow_pickle=False, **arrays)
        command = [str(python), str(SCRIPTS[peer]), str(given), str(made)]
        found = subprocess.run(command, capture_output=True, text=True, check=False)
        if not made.is_file():
            raise RuntimeError(f"{peer} failed: {(found.stderr or found.stdout)[-800:]}")
        if out is not None:
            out.parent.mkdir(parents=True, exist_ok=True)
            out.write_bytes(made.read_bytes())
        return Trajectory.read(made)


def run_casashell(result: Path, rest: str, seconds: float, out: Path) -> Trajectory:
    """`casashell simulate` on a result; kept in ``out`` as the scripts do."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "run"
        command = [sys.executable, "-m", "casashell", "simulate", str(result)]
        command += ["--seconds", str(seconds), "--fps", str(FPS), "--rest", rest, "--quiet"]
        command += ["--no-pictures", "--formats", "", "--out", str(target)]
        found = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ)
        if not (target / "frames.npz").is_file():
            raise RuntimeError(f"casashell simulate failed: {found.stderr[-800:]}")
        record = json.loads((target / "simulation.json").read_text(encoding="utf-8"))
        out.parent.mkdir(parents=True, exist_ok=True)
        with np.load(target / "frames.npz", allow_pickle=False) as file:
            arrays = {key: file[key] for key in ("times", "positions")}
        ended = "" if record["status"] == "COMPLETE" else f" ({record['status']})"
        np.savez_compressed(
            out,
            **arrays,
            seconds=record["seconds"],
            frames=len(arrays["times"]) - 1,
            version=f"casashell{ended}",
        )
    return Trajectory.read(out)
