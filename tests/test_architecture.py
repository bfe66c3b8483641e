"""Direction of imports and the tail of sizes."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MACHINE = sorted((ROOT / "casashell").rglob("*.py"))
PHYSICS = sorted((ROOT / "formulations").rglob("*.py"))
OPEN_TO_PHYSICS = {
    "casashell.engine.energy",
    "casashell.mesh",
    "casashell.ribbon.physics",
    "casashell.typing",
}


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def imported(path: Path) -> set[str]:
    """Modules that a file imports anywhere, inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add("." * node.level + (node.module or ""))
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            called = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
            if called in ("import_module", "__import__") and isinstance(node.args[0], ast.Constant):
                found.add(str(node.args[0].value))
    return found


@pytest.mark.parametrize("path", MACHINE, ids=_name)
def test_the_machine_does_not_know_the_physics(path: Path) -> None:
    if path.is_relative_to(ROOT / "casashell" / "app"):
        return
    assert not {name for name in imported(path) if name.split(".")[0] == "formulations"}


@pytest.mark.parametrize("path", PHYSICS, ids=_name)
def test_the_physics_knows_energies_and_meshes_only(path: Path) -> None:
    used = {name for name in imported(path) if name.split(".")[0] == "casashell"}
    assert used <= OPEN_TO_PHYSICS
    assert len(path.read_text().splitlines()) <= 120


@pytest.mark.parametrize("path", MACHINE + PHYSICS, ids=_name)
def test_files_and_functions_stay_readable(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) <= 350
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            assert length <= 60, f"{node.name} has {length} lines"
        assert not (isinstance(node, ast.ImportFrom) and node.names[0].name == "*")


def test_lazy_imports_are_seen(tmp_path: Path) -> None:
    """The check itself: a breach inside a function, under another name or as a call is found."""
    file = tmp_path / "breach.py"
    for line in (
        "from formulations import discrete_shell",
        "import formulations.edge_stretch as innocent",
        "importlib.import_module('formulations')",
    ):
        file.write_text(f"def f():\n    if True:\n        {line}\n")
        assert any(name.split(".")[0] == "formulations" for name in imported(file))
