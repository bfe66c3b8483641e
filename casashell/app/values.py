"""Single values of a scene as people give them: units, axes, pins, material entries."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from casashell.io.toml_tables import did_you_mean, is_number
from casashell.solving import StepTwoMethod
from casashell.typing import FloatArray

UNITS: Final = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001}
UP_VECTORS: Final = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
METHODS: Final = ("auto", "direct", "two-step", "nlp", "free-pose")
NATURALS: Final = ("mesh", "metric")

Gravity: TypeAlias = float | tuple[float, float, float]


@dataclass(frozen=True)
class ArrayReference:
    """One value per element, kept in an npz file: ``file.npz:key``."""

    path: Path
    key: str

    def read(self) -> FloatArray:
        """The array; ValueError if the key is missing or not numbers, OSError without the file."""
        import zipfile

        try:
            with np.load(self.path, allow_pickle=False) as arrays:
                if self.key not in arrays:
                    hint = did_you_mean(self.key, list(arrays))
                    raise ValueError(f"{self.path} has no array '{self.key}'; {hint}")
                array = arrays[self.key]
        except (zipfile.BadZipFile, EOFError, AttributeError, TypeError):
            raise ValueError(f"{self.path} is not an npz file") from None
        except ValueError as problem:
            if str(problem).startswith(str(self.path)):
                raise
            raise ValueError(f"{self.path} is not an npz file of numbers: {problem}") from None
        if array.dtype.kind not in "iuf":
            raise ValueError(f"{self.path}: array '{self.key}' holds {array.dtype}, not numbers")
        return np.asarray(array, dtype=np.float64)


MaterialValue: TypeAlias = float | ArrayReference
Pins: TypeAlias = tuple[int, ...] | Path


def parse_unit(value: Any, where: str) -> float:
    """Metres per unit from a name or a number (also as text)."""
    if isinstance(value, str) and value.strip() in UNITS:
        return UNITS[value.strip()]
    number = _number(value)
    if number is None or not number > 0.0:
        raise ValueError(
            f"{where}: the unit must be {', '.join(UNITS)} or metres per unit (a number > 0), "
            f"got {value!r}"
        )
    return number


def unit_name(unit: float) -> str:
    """The name of a unit, or its size in metres as text."""
    return next((name for name, size in UNITS.items() if size == unit), f"{unit:g} m")


def parse_material(value: Any, where: str, folder: Path) -> MaterialValue:
    """A number, or ``file.npz:key`` relative to ``folder``."""
    number = _number(value)
    if number is not None:
        return number
    if isinstance(value, str):
        file, colon, key = value.rpartition(":")
        if colon and file.endswith(".npz") and key:
            return ArrayReference(folder / file, key)
    raise ValueError(
        f'{where} must be a finite number or an array in a file, "file.npz:key", got {value!r}'
    )


def parse_gravity(value: Any, where: str) -> Gravity:
    """A strength along -up (>= 0), or three numbers."""
    if isinstance(value, (list, tuple)) and len(value) == 3 and all(map(is_number, value)):
        x, y, z = map(float, value)
        return (x, y, z)
    if not is_number(value):
        raise ValueError(f"{where} must be a finite number or three of them, got {value!r}")
    if value < 0.0:
        raise ValueError(
            f"{where} must be >= 0 m/s2, got {value}: it points along -up by itself; "
            "turn it with the up axis or give a vector in a scene file"
        )
    return float(value)


def parse_tolerance(value: Any, where: str) -> float:
    """A length >= 0, in input units."""
    if not is_number(value) or value < 0.0:
        raise ValueError(f"{where} must be a length >= 0, got {value!r}")
    return float(value)


def parse_friction(value: Any, where: str) -> float:
    """A Coulomb coefficient."""
    if not is_number(value) or value < 0.0:
        raise ValueError(f"{where} must be a number >= 0, got {value!r}")
    return float(value)


def parse_method(value: str, where: str) -> str:
    """The name of a solver that exists."""
    if value not in METHODS:
        raise ValueError(
            f"{where}: no method '{value}' in this version; available: {', '.join(METHODS)}"
        )
    return value


def parse_step2(value: str, where: str) -> StepTwoMethod:
    """The second step of the two-step method."""
    known: dict[str, StepTwoMethod] = {"ipopt": "ipopt", "bfgs": "bfgs"}
    if value not in known:
        raise ValueError(f"{where} must be ipopt or bfgs, got '{value}'")
    return known[value]


def parse_natural(value: str, where: str) -> str:
    """The kind of natural shape."""
    if value not in NATURALS:
        raise ValueError(f"{where} must be {' or '.join(NATURALS)}, got '{value}'")
    return value


def parse_up(value: str, where: str) -> str:
    """x, y or z."""
    if value not in UP_VECTORS:
        raise ValueError(f"{where}: up must be x, y or z, got '{value}'")
    return value


def parse_plane(text: str) -> dict[str, Any]:
    """``NX,NY,NZ,D`` as an obstacle table; ValueError unless four finite numbers."""
    numbers = [_number(part) for part in text.split(",")]
    if len(numbers) != 4 or any(number is None for number in numbers):
        raise ValueError(
            f"--plane {text}: give four finite numbers NX,NY,NZ,D, for example --plane 0,1,0,0"
        )
    return {"kind": "plane", "normal": numbers[:3], "offset": numbers[3]}


def parse_pins(text: str) -> Pins:
    """``3,17,42`` as ids; anything else is the path of a file."""
    if re.fullmatch(r"\s*[-+]?\d+\s*(,\s*[-+]?\d+\s*)*,?\s*", text):
        return tuple(int(part) for part in text.split(",") if part.strip())
    path = Path(text)
    if not text.strip() or (not path.exists() and re.fullmatch(r"[-+\d.,\s]+|.*,.*", text)):
        raise ValueError(
            f"--pin '{text}': give whole numbers, for example --pin 3,17,42, or the name of a file"
        )
    return path


def read_pins(pins: Pins) -> tuple[int, ...]:
    """Vertex ids; a file holds one a line, ``#`` starts a comment.

    Raises ValueError naming file and line, OSError for a file that cannot be read.
    """
    if not isinstance(pins, Path):
        return pins
    try:
        lines = pins.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise ValueError(f"{pins} is not a text file of vertex ids") from None
    ids: list[int] = []
    for number, line in enumerate(lines, start=1):
        for word in line.split("#")[0].replace(",", " ").split():
            if not re.fullmatch(r"[-+]?\d{1,18}", word):
                raise ValueError(f"{pins}, line {number}: '{word[:40]}' is not a vertex id")
            ids.append(int(word))
    if not ids:
        raise ValueError(f"{pins} holds no vertex ids: write one a line, or leave the pins out")
    return tuple(ids)


def _number(value: Any) -> float | None:
    """A finite number from a number or its text, else None."""
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            return None
    return float(value) if is_number(value) and math.isfinite(value) else None
