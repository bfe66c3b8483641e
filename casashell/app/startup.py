"""Entry point of the program: as little as possible before the command runs."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from typing import Final

#: Parts of NumPy that SciPy imports with `from numpy import *` and that no command uses: they take
#: a quarter of all imports.  They are loaded when something does ask for them.
_POSTPONED: Final = ("f2py", "testing")
_INTERRUPTED: Final = 130


def postpone(package: str, names: tuple[str, ...]) -> None:
    """Let submodules of ``package`` load at their first use (`importlib.util.LazyLoader`)."""
    parent = importlib.import_module(package)
    for name in names:
        full = f"{package}.{name}"
        spec = None if full in sys.modules else importlib.util.find_spec(full)
        if spec is None or spec.loader is None:
            continue
        spec.loader = importlib.util.LazyLoader(spec.loader)
        module = importlib.util.module_from_spec(spec)
        sys.modules[full] = module
        spec.loader.exec_module(module)
        setattr(parent, name, module)


def main() -> None:
    """Run the command line; Ctrl-C while it loads ends it without a traceback."""
    try:
        postpone("numpy", _POSTPONED)
        from casashell.app.cli import main as run
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
    run()
