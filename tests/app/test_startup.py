"""What is loaded before a command runs."""

from __future__ import annotations

import subprocess
import sys

import casashell


def _run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_importing_the_package_loads_no_library() -> None:
    code = "import sys, casashell; print([n for n in ('numpy', 'scipy', 'casadi') if n in sys.modules])"
    assert _run(code) == "[]"


def test_every_public_name_is_there_and_stays() -> None:
    assert all(getattr(casashell, name) is not None for name in casashell.__all__)
    assert set(casashell.__all__) <= set(dir(casashell))


def test_the_front_door_is_a_function_whatever_was_imported_before() -> None:
    code = "import casashell.solving, casashell; print(callable(casashell.solve))"
    assert _run(code) == "True"


def test_postponed_parts_of_numpy_load_when_they_are_used() -> None:
    code = (
        "import sys; from casashell.app.startup import postpone; postpone('numpy', ('testing',));"
        "import scipy.sparse; before = 'numpy.testing._private.utils' in sys.modules;"
        "import numpy; numpy.testing.assert_equal(1, 1);"
        "print(before, 'numpy.testing._private.utils' in sys.modules)"
    )
    assert _run(code) == "False True"
