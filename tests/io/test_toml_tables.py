"""Tables of TOML files: errors that show what is wrong."""

from __future__ import annotations

import math

import pytest

from casashell.io.toml_tables import Table


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ([0.0, math.nan, 1.0], r"got \[0\.0, nan, 1\.0\]"),
        ([1.0, 2.0], r"got \[1\.0, 2\.0\]"),
        ([[1.0], 2.0, 3.0], "got a list of 3"),
        (list(range(9)), "got a list of 9"),
        ({"x": 1.0}, "got a table"),
        ("up", "got 'up'"),
    ],
)
def test_a_vector_that_is_none_is_shown(value: object, shown: str) -> None:
    table = Table({"gravity": value}, "scene.toml")
    with pytest.raises(
        ValueError, match=f"scene.toml: gravity must be three finite numbers, {shown}"
    ):
        table.vector("gravity")
