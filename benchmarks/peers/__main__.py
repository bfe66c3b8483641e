"""``python -m benchmarks.peers DIR... --blender PYTHON --newton PYTHON``: the table of PEERS.md.

DIR        folders of results of `casashell invert`
--blender  a Python 3.11 with bpy;  --newton  a Python with newton.  One of them at least
--seconds  2 for drift after two seconds alone, 10 for both;  --newton-seconds  the same for Newton
--out      folder of the trajectories; those that are there and long enough are taken as they are
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks.peers import blender_stiffness
from benchmarks.peers.measures import Row, measured, table
from benchmarks.peers.programs import Trajectory, checked_python, run_casashell, run_script
from benchmarks.peers.scenes import PeerScene

MOMENTS: Final = (2.0, 10.0)
#: Newton: label, name of files, our springs for its triangles, speed of full friction [m/s], shapes.
VARIANTS: Final = (
    ("Newton", "newton", False, 1e-2, ("target", "natural")),
    ("Newton, our energies", "newton-springs", True, 1e-2, ("natural",)),
    ("Newton, our energies, friction from 0.1 mm/s", "newton-fine", True, 1e-4, ("natural",)),
)
_SHAPES: Final = {"target": "the target", "natural": "ours"}


@dataclass(frozen=True)
class Options:
    """The command line, checked."""

    scenes: tuple[PeerScene, ...]
    blender: Path | None
    newton: Path | None
    seconds: float
    newton_seconds: float
    out: Path


def read_options(arguments: Sequence[str]) -> Options:
    """Raises ValueError for a missing or unsuitable Python or a folder that holds no result."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="DIR")
    parser.add_argument("--blender", type=Path)
    parser.add_argument("--newton", type=Path)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--newton-seconds", type=float, default=2.0)
    parser.add_argument("--out", type=Path, default=Path("peers"))
    given = parser.parse_args(arguments)
    if given.blender is None and given.newton is None:
        raise ValueError(
            "no other program to compare with: give --blender or --newton, the python of an "
            "environment with bpy or newton"
        )
    for name in ("seconds", "newton_seconds"):
        if not getattr(given, name) >= 1.0:
            option = name.replace("_", "-")
            raise ValueError(f"--{option} must be at least 1, got {getattr(given, name):g}")
    blender = given.blender and checked_python("--blender", given.blender, "bpy")
    newton = given.newton and checked_python("--newton", given.newton, "newton")
    scenes = tuple(PeerScene.read(folder) for folder in given.folders)
    return Options(scenes, blender, newton, given.seconds, given.newton_seconds, given.out)


def kept(out: Path, seconds: float, run: Callable[[], Trajectory]) -> Trajectory:
    """The trajectory in ``out`` if it is long enough, or a new one."""
    if out.is_file():
        found = Trajectory.read(out)
        if found.times[-1] >= seconds - 1e-6:
            return found
    return run()


def rows_of(scene: PeerScene, options: Options, say: Callable[[str], None]) -> Iterator[Row]:
    """Every program with both natural shapes."""
    for rest in _SHAPES:
        for program, seconds, name, run in _runs(scene, rest, options):
            out = options.out / f"{scene.name}-{name}-{rest}.npz"
            found = kept(out, seconds, partial(run, out))
            row = measured(scene.name, program, _SHAPES[rest], found, scene.result, MOMENTS)
            say(row.cells())
            yield row


def _runs(
    scene: PeerScene, rest: str, options: Options
) -> Iterator[tuple[str, float, str, Callable[[Path], Trajectory]]]:
    """Program, seconds, name of the file and the run into it."""
    seconds, blender, newton = options.seconds, options.blender, options.newton
    ours = partial(run_casashell, scene.folder, rest, seconds)
    yield "casashell", seconds, "casashell", ours
    if blender is not None:
        python = blender

        def in_blender(out: Path) -> Trajectory:
            fit = blender_stiffness.kept(scene, python, options.out)
            return run_script(
                python, "blender", scene.for_blender(rest, seconds, fit.settings(scene)), out
            )

        yield "Blender", seconds, "blender", in_blender
    if newton is not None:
        seconds = options.newton_seconds
        for label, name, springs, slow, shapes in VARIANTS:
            if rest in shapes:
                arrays = scene.for_newton(rest, seconds, springs=springs, slow=slow)
                yield label, seconds, name, partial(run_script, newton, "newton", arrays)


def main(arguments: Sequence[str]) -> int:
    """Print the tables; 2 for bad input."""
    try:
        options = read_options(arguments)
    except (ValueError, OSError) as problem:
        print(f"error: {problem}", file=sys.stderr)
        return 2

    def say(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    rows = [row for scene in options.scenes for row in rows_of(scene, options, say)]
    print(table(rows))
    if options.blender is not None:
        print(f"\n{blender_stiffness.HEAD}\n|" + "---|" * 7)
        for scene in options.scenes:
            print(blender_stiffness.kept(scene, options.blender, options.out).row(scene.name))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
