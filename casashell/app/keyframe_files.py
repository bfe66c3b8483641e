"""Rigid keyframes of an obstacle, read from TOML or CSV.

    center = [0.0, 1.5, 0.0]        # what rotations leave in place, input units; default: the origin

    [[keyframe]]                    # TOML: as many as you like, in order of time
    time = 0.0                      # s
    [[keyframe]]
    time = 0.5
    axis = [0.0, 1.0, 0.0]          # axis and angle in degrees, beyond 360 for more than a turn,
    angle = 30.0
    quaternion = [1.0, 0, 0, 0]     # or w, x, y, z
    translation = [0.1, 0.0, 0.0]   # input units

CSV has the same with a line of names first: ``time`` and any of ``x, y, z`` (translation),
``axis_x, axis_y, axis_z, angle`` or ``qw, qx, qy, qz``; lines that start with ``#`` are comments.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from casashell.dynamics.motion import RigidMotion
from casashell.io.toml_tables import Table, did_you_mean, read_toml
from casashell.typing import FloatArray

_KEYS: Final = ("time", "translation", "axis", "angle", "quaternion")
#: Columns of a CSV file by the key that they make up.
_COLUMNS: Final[Mapping[str, tuple[str, ...]]] = {
    "time": ("time",),
    "translation": ("x", "y", "z"),
    "axis": ("axis_x", "axis_y", "axis_z"),
    "angle": ("angle",),
    "quaternion": ("qw", "qx", "qy", "qz"),
}
#: Angle [rad] below which a quaternion tells no axis.
_NO_AXIS: Final = 1e-9


def read_keyframes(path: Path, unit: float) -> RigidMotion:
    """The motion in a file; ``unit`` is metres per unit of its lengths.

    Raises ValueError naming the file, the keyframe and the key, OSError for a file that cannot be
    opened.
    """
    if path.suffix.lower() not in (".toml", ".csv"):
        raise ValueError(f"{path}: keyframes are read from .toml or .csv")
    if path.suffix.lower() == ".toml":
        top = Table.checked(read_toml(path), str(path), ("center", "keyframe"))
        center = top.vector("center") if "center" in top else (0.0, 0.0, 0.0)
        rows = top.values.get("keyframe", [])
    else:
        center, rows = (0.0, 0.0, 0.0), _csv_rows(path)
    if not isinstance(rows, list) or not rows:
        raise ValueError(f"{path} holds no keyframes: write each under [[keyframe]]")
    keys = [_keyframe(row, f"{path}, keyframe {number}") for number, row in enumerate(rows)]
    times, shifts, turns = zip(*keys)
    try:
        return RigidMotion(
            np.array(times),
            unit * np.array(shifts),
            _unwound(turns),
            unit * np.array(center),
        )
    except ValueError as problem:
        raise ValueError(f"{path}: {problem}") from None


@dataclass(frozen=True)
class _Turn:
    """Rotation vector (3,) rad; whole turns count in axis and angle, a quaternion knows none."""

    vector: FloatArray
    counted: bool


def _keyframe(values: Any, where: str) -> tuple[float, Sequence[float], _Turn]:
    """Time [s], translation (3,) in the unit of the file, rotation."""
    table = Table.checked(values, where, _KEYS)
    table.require("time")
    shift = table.vector("translation") if "translation" in table else (0.0, 0.0, 0.0)
    if "quaternion" in table:
        if "axis" in table or "angle" in table:
            raise ValueError(f"{where}: give a quaternion or axis and angle, not both")
        return table.number("time"), shift, _Turn(_from_quaternion(table), False)
    if ("axis" in table) != ("angle" in table):
        raise ValueError(f"{where}: axis and angle belong together")
    turn = np.zeros(3)
    if "axis" in table:
        axis = np.array(table.vector("axis"))
        angle, length = math.radians(table.number("angle")), float(np.linalg.norm(axis))
        if length == 0.0 and angle != 0.0:
            raise ValueError(f"{where}: the axis has no direction")
        turn = axis * (angle / (length or 1.0))
    return table.number("time"), shift, _Turn(turn, True)


def _from_quaternion(table: Table) -> FloatArray:
    from scipy.spatial.transform import Rotation

    given = table.values["quaternion"]
    if not isinstance(given, list) or len(given) != 4:
        raise table.wrong("quaternion", "four finite numbers w, x, y, z")
    w, x, y, z = (Table({"quaternion": v}, table.where).number("quaternion") for v in given)
    if not any((w, x, y, z)):
        raise ValueError(f"{table.where}: the quaternion is zero")
    return np.asarray(Rotation.from_quat([x, y, z, w]).as_rotvec())


def _unwound(turns: Sequence[_Turn]) -> FloatArray:
    """Rotation vectors (K,3); a quaternion is taken for the turn nearest to the keyframe before."""
    made = [turns[0].vector]
    for turn in turns[1:]:
        vector, before = turn.vector, made[-1]
        if not turn.counted:
            angle, previous = float(np.linalg.norm(vector)), float(np.linalg.norm(before))
            axis = vector / angle if angle > _NO_AXIS else before / (previous or 1.0)
            whole = round((float(before @ axis) - float(vector @ axis)) / (2.0 * math.pi))
            vector = vector + 2.0 * math.pi * whole * axis
        made.append(vector)
    return np.array(made)


def _csv_rows(path: Path) -> list[dict[str, Any]]:
    """The lines of a CSV file as keyframe tables."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not a text file") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if len(lines) < 2:
        raise ValueError(f"{path} holds no keyframes: a line of names, then one line a keyframe")
    names, *rows = (list(map(str.strip, row)) for row in csv.reader(lines))
    known = [column for columns in _COLUMNS.values() for column in columns]
    for name in names:
        if name not in known or names.count(name) > 1:
            raise ValueError(
                f"{path}: unknown or double column '{name}'; {did_you_mean(name, known)}"
            )
    tables = []
    for number, row in enumerate(rows):
        where = f"{path}, keyframe {number}"
        if len(row) != len(names):
            raise ValueError(f"{where} has {len(row)} values for {len(names)} columns")
        tables.append(_table_of(dict(zip(names, row)), where))
    return tables


def _table_of(cells: Mapping[str, str], where: str) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for key, columns in _COLUMNS.items():
        present = [column for column in columns if column in cells]
        if not present:
            continue
        if len(present) < len(columns):
            raise ValueError(f"{where}: {key} needs the columns {', '.join(columns)}")
        values = [_number(cells[column], column, where) for column in columns]
        table[key] = values if len(columns) > 1 else values[0]
    return table


def _number(text: str, column: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{where}: {column} must be a finite number, got '{text}'") from None
    if not math.isfinite(value):
        raise ValueError(f"{where}: {column} must be a finite number, got {text}")
    return value
