"""What ends a command: input errors, failures, interrupts, and how they are shown."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import typer

INPUT_ERROR = 2
FAILURE = 1
INTERRUPTED = 130


class CommandError(Exception):
    """Ends a command with a message for the user and an exit code."""

    def __init__(self, message: str, code: int = INPUT_ERROR) -> None:
        super().__init__(message)
        self.code = code


@contextmanager
def command(debug: bool) -> Iterator[None]:
    """Turns whatever a command raises into a message on stderr and an exit code.

    ``debug`` lets unexpected errors through with their traceback.
    """
    try:
        with warnings.catch_warnings():
            if not debug:  # numbers out of range end up in the status, not in warnings
                warnings.simplefilter("ignore", RuntimeWarning)
            yield
    except typer.Exit:
        raise
    except CommandError as error:
        complain(str(error))
        raise typer.Exit(error.code) from None
    except KeyboardInterrupt:
        complain("interrupted")
        raise typer.Exit(INTERRUPTED) from None
    except BrokenPipeError:  # the reader of a pipe has gone: nobody is left to tell
        raise typer.Exit(FAILURE) from None
    except Exception as error:
        if debug:
            raise
        text = " ".join(str(error).split())
        complain(
            f"unexpected {type(error).__name__}: {text[:300]}\n"
            "This is a fault of the program; run again with --debug for the traceback."
        )
        raise typer.Exit(FAILURE) from None


@contextmanager
def reading_input(*, mended: bool = False) -> Iterator[None]:
    """A ValueError or OSError in the block is the input's fault: exit code 2.

    mended: the mesh has been repaired already.
    """
    from casashell.mesh_checks import MeshError

    try:
        yield
    except MeshError as error:
        hint = "--repair mends what can be mended; casashell check tells whether that is all."
        if mended:
            hint = "This is what --repair leaves: edit the mesh."
        raise CommandError(f"{error}\n{hint}") from error
    except (ValueError, OSError) as error:
        raise CommandError(reason(error)) from error


@contextmanager
def writing_files() -> Iterator[None]:
    """An OSError in the block is the file system's: exit code 1."""
    try:
        yield
    except OSError as error:
        raise CommandError(f"cannot write: {reason(error)}", FAILURE) from error


def reason(error: Exception) -> str:
    """One line without Python's decoration: ``FILE: No such file or directory``."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error)


def complain(message: str) -> None:
    """Print an error on stderr."""
    print(f"casashell: {message}", file=sys.stderr)
