"""The program in this process."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner, Result

from casashell.app.cli import app

#: Pictures take seconds and are tested where they are made.
SILENT = "--no-pictures"


def run(*arguments: str | Path) -> Result:
    """Outcome of ``casashell arguments``."""
    return CliRunner().invoke(app, list(map(str, arguments)))
