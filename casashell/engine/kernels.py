"""Stencil kernels: derivatives of a density by CasADi, run over all stencils in one call.

Each kernel evaluates a few dense outputs per stencil.  With a C compiler the kernel is CasADi's
generated C plus a loop that gathers stencils from the mesh; without one CasADi's virtual machine runs
the mapped function.  A kernel is generated once per density, not per mesh.
"""

from __future__ import annotations

import ctypes
import hashlib
import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from casashell.engine import build_cache
from casashell.typing import AnyArray, FloatArray, IntArray

#: Outputs of each kernel.  g = dE/dx, H = d2E/dx2, M = d2E/dx dr, A = d2(w.g)/dr2, B = d2(w.g)/dr dx,
#: C = d2(w.g)/dx2.
KERNELS: dict[str, tuple[str, ...]] = {
    "energy": ("e",),
    "gradient": ("g",),
    "hessian": ("g", "H"),
    "mixed": ("g", "M"),
    "lagrangian": ("A",),
    "lagrangian_mixed": ("B",),
    "lagrangian_pose": ("C",),
}
_VERSION = "5"

_DRIVER = """
#include <stdint.h>
const int64_t casashell_shape[] = {{{info}}};
#define CASASHELL_STENCIL \\
    const int64_t *v = stencils + {k} * s; \\
    for (int a = 0; a < {k}; ++a) for (int c = 0; c < 3; ++c) {{ \\
      X[3*a+c] = x[3*v[a]+c]; R[3*a+c] = r[3*v[a]+c]; {gather_w} \\
    }} \\
    arg[0] = X; arg[1] = R; arg[2] = p + {m} * s; arg[3] = Q;
#define CASASHELL_ROOM \\
  double X[{dof}], R[{dof}], Q[{dof}], work[{work}]; \\
  long long iwork[{iwork}]; \\
  const double *arg[{args}]; double *res[{ress}];

void casashell_batch(const double *x, const double *r, const double *w, const double *p,
                     const int64_t *stencils, int64_t count, double **out) {{
  CASASHELL_ROOM
  for (int64_t s = 0; s < count; ++s) {{
    CASASHELL_STENCIL
    {outputs}
    {name}(arg, res, iwork, work, 0);
  }}
}}

void casashell_sum(const double *x, const double *r, const double *w, const double *p,
                   const int64_t *stencils, int64_t count, double scale,
                   const int64_t *places, double **out) {{
  CASASHELL_ROOM
  {buffers}
  for (int64_t s = 0; s < count; ++s) {{
    CASASHELL_STENCIL
    {name}(arg, res, iwork, work, 0);
    {sums}
  }}
}}
#undef CASASHELL_STENCIL
#undef CASASHELL_ROOM
"""


@dataclass(frozen=True)
class Shape:
    """Sizes of a kernel: stencil, parameters, and numel of each output (0: identically zero)."""

    k: int
    m: int
    outputs: tuple[int, ...]


def _symbolic(density: ca.Function, kernel: str, prefix: str | None = None) -> ca.Function:
    """SX function (x, r, p, w) -> outputs of ``kernel``, dense; identically zero ones are empty."""
    k = density.size2_in(0)
    x, r = ca.SX.sym("x", 3, k), ca.SX.sym("r", 3, k)
    p, w = ca.SX.sym("p", density.numel_in(2)), ca.SX.sym("w", 3, k)
    e = density(x, r, p)
    g = ca.vec(ca.gradient(e, x))
    made: list[ca.SX] = []
    for output in KERNELS[kernel]:
        value = {
            "e": lambda: e,
            "g": lambda: g,
            "H": lambda: ca.jacobian(g, x),
            "M": lambda: ca.jacobian(g, r),
            "A": lambda: ca.jacobian(ca.vec(ca.gradient(ca.dot(w, ca.reshape(g, 3, k)), r)), r),
            "B": lambda: ca.jacobian(ca.vec(ca.gradient(ca.dot(w, ca.reshape(g, 3, k)), r)), x),
            "C": lambda: ca.jacobian(ca.vec(ca.gradient(ca.dot(w, ca.reshape(g, 3, k)), x)), x),
        }[output]()
        # Row-major blocks: CasADi stores columns, NumPy reads rows.
        made.append(ca.vec(ca.densify(value.T)) if value.nnz() else ca.SX(0, 0))
    return ca.Function(f"{prefix or density.name()}_{kernel}", [x, r, p, w], ca.cse(made))


def _source(function: ca.Function, shape: Shape) -> str:
    """CasADi's C of ``function`` with the gathering loop behind it."""
    name = function.name()  # also the prefix of CasADi's helpers, so that kernels link together
    generator = ca.CodeGenerator(f"{name}.c", {"with_header": False})
    generator.add(function)
    with tempfile.TemporaryDirectory() as folder:
        generator.generate(folder + "/")
        code = (Path(folder) / f"{name}.c").read_text()
    needs_w = name.endswith(("lagrangian", "lagrangian_mixed", "lagrangian_pose"))
    outputs = " ".join(
        f"res[{i}] = out[{i}] + {size} * s;" if size else f"res[{i}] = 0;"
        for i, size in enumerate(shape.outputs)
    )
    buffers = " ".join(
        f"double T{i}[{max(1, size)}]; res[{i}] = {f'T{i}' if size else '0'};"
        for i, size in enumerate(shape.outputs)
    )
    sums = " ".join(_sum(shape, i) for i in range(len(shape.outputs)))
    return code + _DRIVER.format(
        info=", ".join(str(v) for v in (shape.k, shape.m, len(shape.outputs), *shape.outputs)),
        dof=3 * shape.k,
        k=shape.k,
        m=shape.m,
        work=max(1, function.sz_w()),
        iwork=max(1, function.sz_iw()),
        args=max(4, function.sz_arg()),
        ress=max(1, function.sz_res()),
        gather_w="Q[3*a+c] = w[3*v[a]+c];" if needs_w else "",
        outputs=outputs,
        buffers=buffers,
        sums=sums,
        name=name,
    )


def _sum(shape: Shape, i: int) -> str:
    """C that adds output i of a stencil to the total of all."""
    dof, size = 3 * shape.k, shape.outputs[i]
    place = {
        1: "0",
        dof: "3 * v[i / 3] + i % 3",
        dof * dof: f"places[{dof * dof} * s + i]",
    }
    if not size:
        return ""
    return f"for (int i = 0; i < {size}; ++i) out[{i}][{place[size]}] += scale * T{i}[i];"


def _shape(function: ca.Function) -> Shape:
    return Shape(
        function.size2_in(0),
        function.numel_in(2),
        tuple(function.numel_out(i) for i in range(function.n_out())),
    )


def kernel_source(density: ca.Function, kernel: str, prefix: str) -> tuple[str, tuple[int, ...]]:
    """C of a kernel with symbols that start with ``prefix``, and the sizes of its outputs."""
    function = _symbolic(density, kernel, prefix)
    shape = _shape(function)
    code = _source(function, shape)
    for symbol in ("casashell_batch", "casashell_sum", "casashell_shape"):
        code = code.replace(symbol, f"{prefix}_{kernel}_{symbol.removeprefix('casashell_')}")
    return code, shape.outputs


class CompiledKernel:
    """A kernel in a shared library; releases the interpreter lock while it runs."""

    compiled = True

    def __init__(self, path: Path) -> None:
        library = ctypes.CDLL(str(path))
        head = (ctypes.c_int64 * 3).in_dll(library, "casashell_shape")
        full = (ctypes.c_int64 * (3 + head[2])).in_dll(library, "casashell_shape")
        self.shape = Shape(full[0], full[1], tuple(full[3:]))
        self._call = library.casashell_batch
        self._call.restype = None
        self._call.argtypes = [ctypes.c_void_p] * 5 + [ctypes.c_int64, ctypes.c_void_p]
        self._sum = library.casashell_sum
        self._sum.restype = None
        self._sum.argtypes = [ctypes.c_void_p] * 5 + [ctypes.c_int64, ctypes.c_double]
        self._sum.argtypes += [ctypes.c_void_p] * 2

    def __call__(
        self, x: FloatArray, r: FloatArray, p: FloatArray, stencils: IntArray, w: FloatArray
    ) -> tuple[FloatArray, ...]:
        """Outputs of all stencils, each (S, numel); x, r, w (V,3), p (S,m), stencils (S,k)."""
        count = len(stencils)
        made = tuple(np.empty((count, size)) for size in self.shape.outputs)
        table = (ctypes.c_void_p * len(made))(*(a.ctypes.data for a in made))
        arrays = (x, r, w, p, stencils)
        self._call(*(a.ctypes.data for a in arrays), count, ctypes.addressof(table))
        return made

    def add(
        self,
        x: FloatArray,
        r: FloatArray,
        p: FloatArray,
        stencils: IntArray,
        w: FloatArray,
        scale: float,
        places: IntArray | None,
        totals: tuple[FloatArray, ...],
    ) -> None:
        """Add ``scale`` times the sum over all stencils to ``totals``, one array for each output.

        places  (S, 9 k k) where the entries of square blocks go
        """
        table = (ctypes.c_void_p * len(totals))(*(a.ctypes.data for a in totals))
        pointers = [a.ctypes.data for a in (x, r, w, p, stencils)]
        where = None if places is None else places.ctypes.data
        self._sum(*pointers, len(stencils), scale, where, ctypes.addressof(table))


class InterpretedKernel:
    """The same kernel run by CasADi's virtual machine, mapped over the stencils."""

    compiled = False

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self.shape = _shape(function)
        self._mapped: dict[int, ca.Function] = {}

    def __call__(
        self, x: FloatArray, r: FloatArray, p: FloatArray, stencils: IntArray, w: FloatArray
    ) -> tuple[FloatArray, ...]:
        """Outputs of all stencils, each (S, numel); x, r, w (V,3), p (S,m), stencils (S,k)."""
        count = len(stencils)
        made = tuple(np.zeros((count, size)) for size in self.shape.outputs)
        if count == 0:
            return made
        if count not in self._mapped:
            self._mapped[count] = self._function.map(count)
        buffer: Any
        buffer, trigger = self._mapped[count].buffer()  # copies nothing, unlike a call
        inputs: list[AnyArray] = [np.ascontiguousarray(a[stencils]) for a in (x, r)]
        inputs += [np.ascontiguousarray(p), np.ascontiguousarray(w[stencils])]
        for i, array in enumerate(inputs):
            buffer.set_arg(i, array.reshape(-1).data)
        for i, array in enumerate(made):
            if array.size:
                buffer.set_res(i, array.reshape(-1).data)
        trigger()
        return made

    def add(
        self,
        x: FloatArray,
        r: FloatArray,
        p: FloatArray,
        stencils: IntArray,
        w: FloatArray,
        scale: float,
        places: IntArray | None,
        totals: tuple[FloatArray, ...],
    ) -> None:
        """Add ``scale`` times the sum over all stencils to ``totals``; as in `CompiledKernel`."""
        dof = 3 * self.shape.k
        for block, total in zip(self(x, r, p, stencils, w), totals):
            if block.shape[1] == 1:
                total += scale * block.sum()
            elif block.shape[1] == dof:
                index = (3 * stencils[:, :, None] + np.arange(3)).ravel()
                total += scale * np.bincount(index, block.ravel(), minlength=len(total))
            elif block.size and places is not None:
                total += scale * np.bincount(places.ravel(), block.ravel(), minlength=len(total))


Kernel = CompiledKernel | InterpretedKernel


@lru_cache(maxsize=256)
def _load(serialized: str, kernel: str, interpreted: bool) -> Kernel:
    density = ca.Function.deserialize(serialized)
    if interpreted or build_cache.find_compiler() is None:
        return InterpretedKernel(_symbolic(density, kernel))
    text = "|".join(
        (serialized, kernel, _VERSION, ca.CasadiMeta.version(), build_cache.toolchain())
    )
    key = f"{density.name()}-{kernel}-{hashlib.sha256(text.encode()).hexdigest()[:32]}"
    path = build_cache.cached_library(key)
    if path is None:
        function = _symbolic(density, kernel)
        try:
            path = build_cache.build_library(key, _source(function, _shape(function)))
        except build_cache.CompilerError:
            return InterpretedKernel(function)
    return CompiledKernel(path)


def get_kernel(density: ca.Function, kernel: str, *, interpreted: bool = False) -> Kernel:
    """Kernel of ``density``, built at most once per process and compiled at most once per machine.

    kernel       a key of ``KERNELS``
    interpreted  run by CasADi's virtual machine even when a compiler is present
    """
    return _load(density.serialize(), kernel, interpreted)
