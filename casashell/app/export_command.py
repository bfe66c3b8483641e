"""`casashell export`: a saved result in the terms of a simulator."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from casashell.app import options as opt
from casashell.app.failures import CommandError, command, reading_input, writing_files

HELP: Final = (
    "Write the natural shape of a result for a simulator.\n\n"
    "newton: arrays and a loader. vellum: rest lengths and angles as tables, and a script. blender: "
    "two meshes and a script. npz: plain arrays in SI."
)


def export(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a result.")],
    to: Annotated[
        str, typer.Option("--to", metavar="newton|vellum|blender|npz", help="The simulator.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the files. [dim]\\[DIR/NAME][/dim]"),
    ] = None,
    force: opt.Force = False,
    quiet: opt.Quiet = False,
    debug: opt.Debug = False,
) -> None:
    """Read the result, write the files, say where they are."""
    with command(debug):
        run_export(folder, to, out or folder / to, force=force, quiet=quiet)


def run_export(folder: Path, kind: str, out: Path, *, force: bool, quiet: bool) -> None:
    """The whole command.  Raises CommandError for what the user can mend."""
    from casashell.io.exports import export as write
    from casashell.io.results import load_result

    if not folder.is_dir():
        raise CommandError(f"{folder}: no such folder")
    if out.exists() and not out.is_dir():
        raise CommandError(f"--out: {out} is a file, not a folder")
    if out.is_dir() and any(out.iterdir()) and not force:
        raise CommandError(f"{out} exists and is not empty: choose another --out or add --force")
    with reading_input():
        result = load_result(folder)
    with writing_files():
        try:
            names = write(result, kind, out)
        except ValueError as problem:
            raise CommandError(str(problem)) from None
    if not quiet:
        if not result.status.certified:
            print(f"note: status {result.status}, not a certified natural shape")
        print(f"wrote {', '.join(names)} to {out}")
