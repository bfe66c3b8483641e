"""Options of the command line: their types for typer, and how they become a `SceneSpec`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

if TYPE_CHECKING:
    from casashell.app.scene import ObstacleSource, SceneSpec

_SCENE, _MATERIAL, SOLVER, _OUTPUT = "Scene", "Material", "Solver", "Output"


def _text(text: str, *, default: str) -> str:
    """Help with the default at its end."""
    return f"{text} [dim]\\[{default}][/dim]"


Shell: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="SHELL|SCENE.toml",
        help="Mesh of the designed shape (OBJ, PLY, STL, OFF, ...), or a scene file. "
        "Options override what a scene file says.",
        show_default=False,
    ),
]
Obstacles: TypeAlias = Annotated[
    list[Path] | None,
    typer.Option(
        "--obstacle",
        metavar="FILE",
        rich_help_panel=_SCENE,
        help=_text(
            "Closed mesh the shell rests on, same units and axes as SHELL. Repeat for more.",
            default="none",
        ),
        show_default=False,
    ),
]
Planes: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--plane",
        metavar="NX,NY,NZ,D",
        rich_help_panel=_SCENE,
        help=_text(
            "Floor, wall or slope: the shell lives where n.x >= D (input units). "
            "0,1,0,0 is a floor at height 0. Repeat for more.",
            default="none",
        ),
        show_default=False,
    ),
]
Pin: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="FILE|LIST",
        rich_help_panel=_SCENE,
        help=_text(
            "Vertices held in place: a text file with one index from 0 a line, or 3,17,42.",
            default="none",
        ),
        show_default=False,
    ),
]
Up: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="x|y|z",
        rich_help_panel=_SCENE,
        help=_text(
            "Up axis of the files; gravity points the other way.",
            default="y",
        ),
        show_default=False,
    ),
]
Unit: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="m|dm|cm|mm|FLOAT",
        rich_help_panel=_SCENE,
        help=_text(
            "Unit of the files, by name or in metres.",
            default="m",
        ),
        show_default=False,
    ),
]
GravityOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--gravity",
        metavar="FLOAT",
        rich_help_panel=_SCENE,
        help=_text(
            "Gravity along -up, m/s2.",
            default="9.81",
        ),
        show_default=False,
    ),
]
Tolerance: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="T",
        rich_help_panel=_SCENE,
        help=_text(
            "A vertex touches an obstacle when its signed distance is below T (input units).",
            default="0.5 % of the shell's bounding box diagonal",
        ),
        show_default=False,
    ),
]
Friction: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="MU",
        rich_help_panel=_SCENE,
        help=_text(
            "Friction coefficient of every obstacle.",
            default="0.5",
        ),
        show_default=False,
    ),
]
Repair: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--repair",
        rich_help_panel=_SCENE,
        help="Mend the mesh first (weld, drop, turn over) and say what was done.",
    ),
]
Density: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="FLOAT",
        rich_help_panel=_MATERIAL,
        help=_text(
            "Mass per area, kg/m2.",
            default="0.2",
        ),
        show_default=False,
    ),
]
Stretch: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="FLOAT",
        rich_help_panel=_MATERIAL,
        help=_text(
            "Stretching stiffness k_L of an edge, N.",
            default="20",
        ),
        show_default=False,
    ),
]
Bend: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="FLOAT",
        rich_help_panel=_MATERIAL,
        help=_text(
            "Bending stiffness k_theta of a hinge, J.  Each of the three may also be "
            "FILE.npz:KEY with one value per face, edge, hinge.",
            default="0.001",
        ),
        show_default=False,
    ),
]
Method: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="auto|direct|two-step|nlp|free-pose",
        rich_help_panel=SOLVER,
        help=_text(
            "direct: Newton on the natural shape; two-step: Ly 2018; nlp: one nonlinear program; "
            "free-pose: the closest stable pose when the target cannot be held; "
            "auto: the cheapest, direct.",
            default="auto",
        ),
        show_default=False,
    ),
]
Step2: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="ipopt|bfgs",
        rich_help_panel=SOLVER,
        help=_text(
            "Second step of two-step: a program with cone constraints, or descent.",
            default="ipopt",
        ),
        show_default=False,
    ),
]
Prefer: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="MESH",
        rich_help_panel=SOLVER,
        help="Natural shape to stay near where contacts leave a choice: a flat sheet, an old version.",
        show_default=False,
    ),
]
Natural: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="mesh|metric",
        rich_help_panel=SOLVER,
        help=_text(
            "metric: also rest lengths and angles (metric.npz), and those alone where the "
            "material is too soft for a natural mesh; see casashell export.",
            default="mesh",
        ),
        show_default=False,
    ),
]
Out: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        rich_help_panel=_OUTPUT,
        help=_text(
            "Folder for the result.",
            default="SHELL-natural in the current folder",
        ),
        show_default=False,
    ),
]
Force: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--force", rich_help_panel=_OUTPUT, help="Replace the result in a folder with files."
    ),
]
NoPictures: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--no-pictures",
        rich_help_panel=_OUTPUT,
        help="No picture files; report.html has a 3-D view all the same.",
    ),
]
Quiet: TypeAlias = Annotated[
    bool, typer.Option("--quiet", "-q", rich_help_panel=_OUTPUT, help="Print errors only.")
]
Json: TypeAlias = Annotated[
    bool,
    typer.Option("--json", rich_help_panel=_OUTPUT, help="Print JSON on stdout, nothing else."),
]
Debug: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--debug",
        rich_help_panel=_OUTPUT,
        envvar="CASASHELL_DEBUG",
        help="Show the traceback of an unexpected error.",
    ),
]


@dataclass(frozen=True)
class SceneOptions:
    """The scene options as typed; None where not given."""

    shell: Path
    obstacles: tuple[Path, ...] = ()
    planes: tuple[str, ...] = ()
    pin: str | None = None
    up: str | None = None
    unit: str | None = None
    gravity: float | None = None
    tolerance: float | None = None
    friction: float | None = None
    density: str | None = None
    stretch: str | None = None
    bend: str | None = None
    method: str | None = None
    step2: str | None = None
    prefer: Path | None = None
    natural: str | None = None

    def spec(self) -> SceneSpec:
        """The scene file with the options over it, or the options alone.

        Obstacles and planes add to those of a scene file, the rest overrides.  Raises ValueError
        naming option or file, OSError for a scene file that cannot be opened.
        """
        from casashell.app.scene import SceneSpec
        from casashell.app.scene_reader import read_scene

        if self.shell.suffix.lower() == ".toml":
            base = read_scene(self.shell)
        else:
            hint = self.shell / "scene.toml"
            if hint.is_file():
                raise ValueError(f"{self.shell} is a folder; did you mean {hint}?")
            base = SceneSpec(self.shell)
        return replace(base, **self._overrides(base))

    def _overrides(self, base: SceneSpec) -> dict[str, Any]:
        from casashell.app import values

        over: dict[str, Any] = {"obstacles": (*base.obstacles, *self._sources())}
        for key in ("density", "stretch", "bend"):
            if (text := getattr(self, key)) is not None:
                over[key] = values.parse_material(text, f"--{key}", Path())
        if self.pin is not None:
            over["pinned"] = values.parse_pins(self.pin)
        if self.unit is not None:
            over["unit"] = values.parse_unit(self.unit, "--unit")
        if self.up is not None:
            over["up"] = values.parse_up(self.up, "--up")
            if isinstance(base.gravity, tuple):  # a vector of a scene file turns with the axis
                over["gravity"] = math.hypot(*base.gravity)
        if self.gravity is not None:
            over["gravity"] = values.parse_gravity(self.gravity, "--gravity")
        if self.tolerance is not None:
            over["tolerance"] = values.parse_tolerance(self.tolerance, "--tolerance")
        if self.friction is not None:
            over["friction"] = values.parse_friction(self.friction, "--friction")
        if self.method is not None:
            over["method"] = values.parse_method(self.method, "--method")
        if self.step2 is not None:
            over["step2"] = values.parse_step2(self.step2, "--step2")
        if self.prefer is not None:
            over["prefer"] = self.prefer
        if self.natural is not None:
            over["natural"] = values.parse_natural(self.natural, "--natural")
        return over

    def _sources(self) -> list[ObstacleSource]:
        from casashell.app.scene import ObstacleSource
        from casashell.app.values import parse_plane

        meshes = [
            ObstacleSource({"kind": "mesh", "file": str(path)}, f"--obstacle {path}")
            for path in self.obstacles
        ]
        return meshes + [
            ObstacleSource(parse_plane(text), f"--plane {text}") for text in self.planes
        ]
