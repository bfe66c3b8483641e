"""Strict reading of TOML tables and plain writing of them.

Reading knows no schema: a `Table` hands out typed values and refuses what nobody asked for, with
the file, the table and the nearest known key in the message.
"""

from __future__ import annotations

import difflib
import json
import math
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

Value: TypeAlias = "str | bool | int | float | Sequence[Value]"


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises ValueError naming the file for bytes that are not UTF-8 and for syntax errors, OSError
    for a file that cannot be opened.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as problem:
        raise ValueError(f"{path} is not a text file in UTF-8: {problem.reason}") from None
    except tomllib.TOMLDecodeError as problem:
        raise ValueError(f"{path} is not valid TOML: {problem}") from None


def did_you_mean(word: str, known: Collection[str]) -> str:
    """`` (did you mean 'density'?)`` or the list of what is known."""
    close = difflib.get_close_matches(word.lower(), sorted(known), n=1, cutoff=0.55)
    if close:
        return f"did you mean '{close[0]}'?"
    return f"known: {', '.join(sorted(known))}"


@dataclass(frozen=True)
class Table:
    """One table of a scene file; ``where`` opens every message: ``scene.toml, [shell]``."""

    values: Mapping[str, Any]
    where: str

    @staticmethod
    def checked(values: Any, where: str, known: Collection[str]) -> Table:
        """A table without keys outside ``known``; ValueError names the first that is."""
        if not isinstance(values, Mapping):
            raise ValueError(f"{where} must be a table, got {_kind(values)}")
        for key in values:
            if key not in known:
                raise ValueError(f"{where}: unknown key '{key}'; {did_you_mean(key, known)}")
        return Table(values, where)

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def wrong(self, key: str, wanted: str) -> ValueError:
        """The error for a value of the wrong kind."""
        given = self.values.get(key)
        shown = _kind(given) if isinstance(given, (Mapping, list)) else repr(given)
        return ValueError(f"{self.where}: {key} must be {wanted}, got {shown}")

    def require(self, *keys: str) -> None:
        """ValueError if one of the keys is absent."""
        for key in keys:
            if key not in self.values:
                raise ValueError(f"{self.where}: {key} is missing")

    def text(self, key: str, default: str = "") -> str:
        """A string."""
        value = self.values.get(key, default)
        if not isinstance(value, str):
            raise self.wrong(key, "text in quotes")
        return value

    def choice(self, key: str, options: Sequence[str], default: str) -> str:
        """One of a few words."""
        value = self.text(key, default)
        if value not in options:
            raise ValueError(
                f"{self.where}: {key} must be one of {', '.join(options)}, got '{value}'"
            )
        return value

    def flag(self, key: str) -> bool:
        """True or false; false when absent."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            raise self.wrong(key, "true or false")
        return value

    def number(self, key: str) -> float:
        """A finite number."""
        value: Any = self.values.get(key)
        if not is_number(value):
            raise self.wrong(key, "a finite number")
        return float(value)

    def vector(self, key: str) -> tuple[float, float, float]:
        """Three finite numbers."""
        value = self.values.get(key)
        if not isinstance(value, list) or len(value) != 3 or not all(map(is_number, value)):
            raise self.wrong(key, "three finite numbers")
        x, y, z = map(float, value)
        return (x, y, z)

    def whole_numbers(self, key: str) -> tuple[int, ...]:
        """A list of whole numbers."""
        value = self.values.get(key)
        if not isinstance(value, list) or not all(type(item) is int for item in value):
            raise self.wrong(key, "a list of whole numbers")
        return tuple(value)


def is_number(value: Any) -> bool:
    """True for a finite int or float, not for true and false."""
    return type(value) in (int, float) and math.isfinite(value)


def _kind(value: Any) -> str:
    if isinstance(value, Mapping):
        return "a table"
    short = isinstance(value, list) and len(value) <= 4 and not any(map(_nested, value))
    return f"a list of {len(value)}" if isinstance(value, list) and not short else repr(value)


def _nested(value: Any) -> bool:
    return isinstance(value, (list, Mapping))


def write_table(header: str, values: Mapping[str, Value]) -> str:
    """A TOML table as text: ``header`` is ``[shell]``, ``[[obstacle]]`` or empty."""
    lines = [header] if header else []
    lines += [f"{key} = {_written(value)}" for key, value in values.items()]
    return "\n".join(lines) + "\n"


def _written(value: Value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON strings are TOML basic strings, but for DEL, which only TOML forbids raw
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (int, float)):
        return repr(value)
    return "[" + ", ".join(_written(item) for item in value) + "]"
