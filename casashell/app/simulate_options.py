"""Options of `casashell simulate`: their types for typer, and the values they stand for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import typer

if TYPE_CHECKING:
    from casashell.dynamics.system import Damping
    from formulations.wind import FaceWind

_MOTION, _AIR, _OUTPUT = "Motion", "Air", "Output"

#: What the air is like unless told otherwise; those of `formulations.wind.FaceWind`.
AIR: Final = {"air": 1.2, "drag": 1.2, "lift": 0.6, "onset": 0.0}

Folder: TypeAlias = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of a result of casashell invert.")
]
Seconds: TypeAlias = Annotated[
    float, typer.Option("--seconds", metavar="S", help="How much time passes, s.")
]
Fps: TypeAlias = Annotated[float, typer.Option(metavar="N", help="Frames a second that are kept.")]
Substeps: TypeAlias = Annotated[
    int, typer.Option(metavar="N", help="Steps a frame; a step that fails is halved by itself.")
]
Rest: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="natural|target",
        help="natural: the natural shape of the result. target: the design itself is taken for "
        "unstressed, as without inversion.",
    ),
]
DampingOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--damping",
        metavar="MASS[,STIFFNESS]",
        help="Rayleigh damping in 1/s and s, beside that of implicit steps. [dim]\\[none][/dim]",
    ),
]
Sequences: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--obstacle-sequence",
        metavar="[WHICH=]FILES",
        rich_help_panel=_MOTION,
        help="Numbered meshes that an obstacle deforms through: a folder, or a pattern as "
        "'body_*.obj' or body_%04d.ply, in quotes. Same unit, axes and faces as in the scene, the "
        "first as there. WHICH: name or number (from 0) of the obstacle. Repeat for more.",
        show_default=False,
    ),
]
SequenceFps: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--sequence-fps",
        metavar="N",
        rich_help_panel=_MOTION,
        help="Meshes of the sequences a second. [dim]\\[--fps][/dim]",
        show_default=False,
    ),
]
Keyframes: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--keyframes",
        metavar="[WHICH=]FILE",
        rich_help_panel=_MOTION,
        help="Rigid motion of an obstacle: TOML or CSV with times, rotations and translations. "
        "Repeat for more.",
        show_default=False,
    ),
]
WindOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--wind",
        metavar="X,Y,Z",
        rich_help_panel=_AIR,
        help="Velocity of the air in the axes of the input, m/s; 0,0,0 is still air that brakes. "
        "[dim]\\[no air][/dim]",
        show_default=False,
    ),
]
Gusts: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="G[,PERIOD[,SEED]]",
        rich_help_panel=_AIR,
        help="Gusts: standard deviation in the mean speed, typical period in s, number of the "
        "weather. [dim]\\[0,1,0][/dim]",
        show_default=False,
    ),
]
Air: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--air-density",
        metavar="RHO",
        rich_help_panel=_AIR,
        help=f"kg/m3. [dim]\\[{AIR['air']}][/dim]",
        show_default=False,
    ),
]
Drag: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="CD",
        rich_help_panel=_AIR,
        help=f"Drag coefficient of a face. [dim]\\[{AIR['drag']}][/dim]",
        show_default=False,
    ),
]
Lift: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="CL",
        rich_help_panel=_AIR,
        help=f"Lift coefficient of a face, at most that of drag. [dim]\\[{AIR['lift']}][/dim]",
        show_default=False,
    ),
]
Onset: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--wind-onset",
        metavar="S",
        rich_help_panel=_AIR,
        help="Time in which the wind rises from nothing, s. [dim]\\[0][/dim]",
        show_default=False,
    ),
]
Out: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="SIMDIR",
        rich_help_panel=_OUTPUT,
        help="Folder for the simulation. [dim]\\[DIR-simulation][/dim]",
        show_default=False,
    ),
]
Formats: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="LIST",
        rich_help_panel=_OUTPUT,
        help="Files beside frames.npz, with commas between: obj, vtk, usd, mp4, gif. The player "
        "(html) is always written.",
    ),
]
NoPictures: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--no-pictures", rich_help_panel=_OUTPUT, help="No picture of the end beside the start."
    ),
]
Resume: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--resume",
        rich_help_panel=_OUTPUT,
        help="Go on with a run that was killed or interrupted; give the same options again.",
    ),
]


@dataclass(frozen=True)
class AirOptions:
    """Wind as typed; None where not given."""

    wind: str | None = None
    gusts: str | None = None
    air: float | None = None
    drag: float | None = None
    lift: float | None = None
    onset: float | None = None

    def read(self) -> FaceWind | None:
        """The wind, or None; ValueError naming the option."""
        given = {key: getattr(self, key) for key in AIR if getattr(self, key) is not None}
        if self.wind is None:
            if given or self.gusts is not None:
                raise ValueError("--gusts and what describes the air need --wind X,Y,Z")
            return None
        from formulations.wind import FaceWind

        x, y, z = numbers(self.wind, "--wind", 3, 3, "X,Y,Z in m/s")
        gust: dict[str, float] = {}
        if self.gusts is not None:
            values = numbers(self.gusts, "--gusts", 1, 3, "strength, period, seed")
            gust = dict(zip(("gust", "period", "seed"), values))
        seed = gust.pop("seed", 0.0)
        if seed != int(seed) or seed < 0:
            raise ValueError(f"--gusts {self.gusts}: the seed must be a whole number >= 0")
        return FaceWind((x, y, z), **(AIR | given), **gust, seed=int(seed))


@dataclass(frozen=True)
class SimulateOptions:
    """All that decides which frames come out, as typed."""

    folder: Path
    seconds: float
    fps: float = 60.0
    substeps: int = 1
    rest: str = "natural"
    damping: str | None = None
    sequences: tuple[str, ...] = ()
    sequence_fps: float | None = None
    keyframes: tuple[str, ...] = ()
    air: AirOptions = field(default_factory=AirOptions)

    def check(self) -> None:
        """ValueError naming the option that makes no sense by itself."""
        for name in ("seconds", "fps"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"--{name} must be a positive number, got {value:g}")
        rate = self.sequence_fps
        if rate is not None and not (math.isfinite(rate) and rate > 0.0):
            raise ValueError(f"--sequence-fps must be a positive number, got {rate:g}")
        if self.substeps < 1:
            raise ValueError(f"--substeps must be at least 1, got {self.substeps}")
        if self.rest not in ("natural", "target"):
            raise ValueError(f"--rest must be natural or target, got '{self.rest}'")

    def read_damping(self) -> Damping:
        """ValueError unless one or two numbers >= 0."""
        from casashell.dynamics.system import Damping

        if self.damping is None:
            return Damping()
        return Damping(*numbers(self.damping, "--damping", 1, 2, "MASS or MASS,STIFFNESS"))


def numbers(text: str, option: str, least: int, most: int, what: str) -> list[float]:
    """Finite numbers with commas between; ValueError naming the option."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if not least <= len(values) <= most or not all(map(math.isfinite, values)):
        raise ValueError(f"{option} {text}: give {what}, finite numbers with commas between")
    return values
