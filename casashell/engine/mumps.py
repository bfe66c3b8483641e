"""MUMPS from the library that CasADi's wheel brings for Ipopt, through ctypes.

The control structure is read from the header of the installed wheel, never written down here: its
layout follows the MUMPS version.
"""

from __future__ import annotations

import ctypes
import re
import weakref
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Final

import casadi as ca
import numpy as np

from casashell.engine.sparse_solver import SingularMatrix, Symmetry, check_rhs
from casashell.typing import FloatArray, IntArray

_USE_COMM_WORLD = -987654
_TYPES: Final[dict[str, Any]] = {
    "MUMPS_INT": ctypes.c_int,
    "MUMPS_INT8": ctypes.c_int64,
    "DMUMPS_COMPLEX": ctypes.c_double,
    "DMUMPS_REAL": ctypes.c_double,
    "char": ctypes.c_char,
}
_INTEGERS, _NUMBERS = ctypes.POINTER(ctypes.c_int), ctypes.POINTER(ctypes.c_double)
#: A pointer, a number or an array of a length that is a sum.
_MEMBER: Final = re.compile(r"(\*?)\s*(\w+)\s*(?:\[([\d\s+]+)\])?")
_ERRORS = {
    -6: "the matrix is structurally singular",
    -10: "the matrix is numerically singular",
    -13: "not enough memory",
}


def _folder() -> Path:
    return Path(ca.__file__).parent


def _library() -> Path:
    for pattern in ("libcoinmumps.so.*", "libcoinmumps.*.dylib", "libcoinmumps-*.dll"):
        found = sorted(_folder().glob(pattern))
        if found:
            return found[0]
    raise OSError("CasADi's package has no MUMPS library")


#: Unknowns from which several threads pay: the dense blocks of smaller matrices are too small, and
#: threads that wait for each other take the processor from everybody else.
_MANY: Final = 20_000


def _header() -> Path:
    for pattern in ("include/*/*/dmumps_c.h", "include/**/dmumps_c.h"):
        found = sorted(_folder().glob(pattern))
        if found:
            return found[0]
    raise OSError("CasADi's package has no dmumps_c.h")


def _fields(text: str) -> list[tuple[str, Any]]:
    """Members of the structure in a header, in order; raises OSError for what it cannot read."""
    version = re.search(r"define\s+MUMPS_VERSION_MAX_LEN\s+(\d+)", text)
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    found = re.search(r"typedef\s+struct\s*\{(.*?)\}\s*DMUMPS_STRUC_C\s*;", text, flags=re.S)
    if found is None:
        raise OSError("cannot read the MUMPS structure from dmumps_c.h")
    struct = re.sub(r"^\s*#.*$", "", found.group(1), flags=re.M)
    struct = struct.replace("MUMPS_VERSION_MAX_LEN", version.group(1) if version else "30")
    fields: list[tuple[str, Any]] = []
    for declaration in filter(None, map(str.strip, struct.split(";"))):
        kind, _, names = declaration.partition(" ")
        for name in names.split(","):
            member = _MEMBER.fullmatch(name.strip())
            if kind not in _TYPES or member is None:
                raise OSError(f"cannot read '{declaration}' in dmumps_c.h")
            pointer, label, size = member.groups()
            made = ctypes.POINTER(_TYPES[kind]) if pointer else _TYPES[kind]
            if size:
                made = made * sum(int(number) for number in size.split("+"))
            fields.append((label, made))
    return fields


@cache
def _open() -> tuple[type[ctypes.Structure], Any]:
    """The control structure and the library; raises OSError when either is missing."""
    fields = _fields(_header().read_text())
    return type("Control", (ctypes.Structure,), {"_fields_": fields}), ctypes.CDLL(str(_library()))


@cache
def _threads() -> tuple[Callable[[int], None], int]:
    """Sets the threads of the BLAS that MUMPS calls; how many it has by default.

    Does nothing where CasADi's package brings another BLAS.
    """
    for path in sorted(_folder().glob("libcasadi-tp-openblas.so.*")):
        try:
            blas = ctypes.CDLL(str(path))
            return blas.openblas_set_num_threads, int(blas.openblas_get_num_threads())
        except (OSError, AttributeError):
            continue
    return lambda count: None, 1


def _finish(library: Any, state: Any) -> None:
    state.job = -2
    library.dmumps_c(ctypes.byref(state))


class Mumps:
    """Sparse LU or LDL^T of one pattern; with inertia when symmetric."""

    name = "mumps"

    def __init__(self, indptr: IntArray, indices: IntArray, symmetry: Symmetry) -> None:
        self._control, self._library = _open()
        self._size = len(indptr) - 1
        row = np.repeat(np.arange(self._size), np.diff(indptr))
        self._symmetric = symmetry == "symmetric"
        self._pivoting = symmetry != "unpivoted"
        self._keep = np.flatnonzero(row >= indices) if self._symmetric else None
        chosen = slice(None) if self._keep is None else self._keep
        self._row = (row[chosen] + 1).astype(np.int32)
        self._column = (np.asarray(indices)[chosen] + 1).astype(np.int32)
        self._values = np.ones(len(self._row))
        self._start()

    def _start(self) -> None:
        state: Any = self._control()
        state.par, state.sym, state.job = 1, 2 if self._symmetric else 0, -1
        state.comm_fortran = _USE_COMM_WORLD
        self._library.dmumps_c(ctypes.byref(state))
        for i in range(3):
            state.icntl[i] = -1
        state.icntl[3] = 0
        # AMD analyses faster and orders small matrices better; METIS wins on large ones.
        state.icntl[6] = 0 if self._size < 5000 else 5
        if not self._pivoting:
            state.icntl[5] = state.icntl[7] = 0
            state.cntl[0] = 0.0
        state.n, state.nnz = self._size, len(self._row)
        state.irn = self._row.ctypes.data_as(_INTEGERS)
        state.jcn = self._column.ctypes.data_as(_INTEGERS)
        state.a = self._values.ctypes.data_as(_NUMBERS)
        self._state = state
        self._close = weakref.finalize(self, _finish, self._library, state)
        self._analysed = False

    def _run(self, job: int) -> int:
        self._state.job = job
        set_threads, usual = _threads()
        set_threads(1 if self._size < _MANY else usual)
        try:
            self._library.dmumps_c(ctypes.byref(self._state))
        finally:
            set_threads(usual)
        return int(self._state.infog[0])

    def factor(self, data: FloatArray) -> None:
        """Factor the matrix with entries ``data``; raises SingularMatrix."""
        self._values[:] = data if self._keep is None else data[self._keep]
        if not np.all(np.isfinite(self._values)):
            raise SingularMatrix("the matrix has entries that are not finite")
        if not self._analysed:
            # Values take part in the analysis of unsymmetric matrices (scaling, permutation).
            code = self._run(1)
            if code < 0:
                raise SingularMatrix(f"MUMPS analysis: {_ERRORS.get(code, f'error {code}')}")
            self._analysed = True
        for room in (None, 50, 200, 800):  # per cent of extra workspace for pivoting
            if room is not None:
                self._state.icntl[13] = room
            code = self._run(2)
            if code not in (-8, -9, -14, -15, -17, -20):
                break
        if code < 0:
            raise SingularMatrix(f"MUMPS: {_ERRORS.get(code, f'error {code}')}")

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solution of the last factored matrix; rhs (n,) or (n, m)."""
        check_rhs(rhs, self._size)
        columns = np.asfortranarray(np.array(rhs, dtype=np.float64, order="F", copy=True))
        self._state.nrhs = 1 if columns.ndim == 1 else columns.shape[1]
        self._state.lrhs = self._size
        self._state.rhs = columns.ctypes.data_as(_NUMBERS)
        code = self._run(3)
        if code < 0:
            raise SingularMatrix(f"MUMPS solve: {_ERRORS.get(code, f'error {code}')}")
        return columns

    @property
    def negative_eigenvalues(self) -> int | None:
        """Number of negative pivots of the last symmetric factorisation."""
        return int(self._state.infog[11]) if self._symmetric else None
