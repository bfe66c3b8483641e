"""Functions of a nonlinear program as CasADi callbacks on raw buffers, for `casashell.engine.nlp`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from casashell.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from casashell.engine.nlp import Nlp


@dataclass(frozen=True, eq=False)
class Iterate:
    """What is known during a run: after ``iteration`` steps, at the point ``x``.

    violation  largest violation of a constraint or bound
    """

    iteration: int
    x: FloatArray
    objective: float
    violation: float


Report = Callable[[Iterate], None]
Option = str | float | int


class _Callback(ca.Callback):
    """A NumPy function on CasADi's buffers; ``write`` fills the outputs that are asked for."""

    def __init__(
        self,
        name: str,
        inputs: Sequence[ca.Sparsity],
        outputs: Sequence[ca.Sparsity],
        write: Callable[[Sequence[FloatArray], Sequence[FloatArray]], int],
    ) -> None:
        ca.Callback.__init__(self)
        self._inputs, self._outputs, self._write = inputs, outputs, write
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self._inputs[i]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._outputs[i]

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arguments: Sequence[Any], results: Sequence[Any]) -> int:
        return self._write([_array(a) for a in arguments], [_array(r) for r in results])


def _array(memory: Any) -> FloatArray:
    """View of a buffer; empty when CasADi does not supply or want the values."""
    return np.frombuffer(memory, dtype=np.float64) if memory is not None else np.empty(0)


class Calls:
    """The callbacks of one run.  No exception passes through CasADi: the first one is kept."""

    def __init__(self, nlp: Nlp, report: Report | None) -> None:
        self.nlp, self.report = nlp, report
        self.error: BaseException | None = None
        self.waiting: list[Any] = []
        self.iteration = 0
        n, m = len(nlp.start), len(nlp.constraint_lower)
        self._x, self._p = ca.Sparsity.dense(n, 1), ca.Sparsity(0, 1)
        self._f, self._g = ca.Sparsity.dense(1, 1), ca.Sparsity.dense(m, 1)
        self._jacobian, self._jacobian_place = _compressed(
            nlp.jacobian_rows, nlp.jacobian_columns, m, n
        )
        upper = np.minimum(nlp.hessian_rows, nlp.hessian_columns)
        across = np.maximum(nlp.hessian_rows, nlp.hessian_columns)
        self._hessian, self._hessian_place = _compressed(upper, across, n, n)

    def _guarded(self, fill: Callable[[Any, Any], None]) -> Callable[[Any, Any], int]:
        def write(arguments: Any, results: Any) -> int:
            if self.error is not None or self.waiting:
                return 1
            try:
                fill(arguments, results)
            except BaseException as error:  # also KeyboardInterrupt: raised again by `minimise`
                self.error = error
                return 1
            return 0

        return write

    def solver(self, settings: Mapping[str, Option]) -> ca.Function:
        """CasADi's solver, which keeps the callbacks alive through this object."""
        nlp, x, p = self.nlp, self._x, self._p

        def gradient(a: Any, r: Any) -> None:
            _fill(r[0], lambda: np.array([nlp.objective(a[0])]))
            _fill(r[1], lambda: nlp.objective_gradient(a[0]))

        def jacobian(a: Any, r: Any) -> None:
            _fill(r[0], lambda: nlp.constraints(a[0]))
            _fill(r[1], lambda: _summed(self._jacobian_place, nlp.jacobian(a[0]), len(r[1])))

        def hessian(a: Any, r: Any) -> None:
            entries = nlp.hessian(a[0], float(a[2][0]), a[3])
            r[0][:] = _summed(self._hessian_place, entries, len(r[0]))

        def make(name: str, ins: Any, outs: Any, fill: Callable[[Any, Any], None]) -> _Callback:
            return _Callback(name, ins, outs, self._guarded(fill))

        f, g = self._f, self._g
        cost = make("cost", [x], [f], lambda a, r: _fill(r[0], lambda: [nlp.objective(a[0])]))
        limits = make("limits", [x], [g], lambda a, r: _fill(r[0], lambda: nlp.constraints(a[0])))
        derivatives = {
            "grad_f": make("grad_f", [x, p], [f, x], gradient),
            "jac_g": make("jac_g", [x, p], [g, self._jacobian], jacobian),
            "hess_lag": make("hess_lag", [x, p, f, g], [self._hessian], hessian),
        }
        each = _Callback("each", [x, f, g, x, g, p], [f], self._each)
        self._alive = (cost, limits, derivatives, each)
        symbol = ca.MX.sym("x", x)
        return ca.nlpsol(
            "solver",
            "ipopt",
            {"x": symbol, "f": cost(symbol), "g": limits(symbol)},
            {
                **derivatives,
                "no_nlp_grad": True,
                "iteration_callback": each,
                "print_time": False,
                "show_eval_warnings": False,
                "ipopt": dict(settings),
            },
        )

    def _each(self, arguments: Sequence[FloatArray], results: Sequence[FloatArray]) -> int:
        """Iteration callback: a result other than zero ends the run."""
        results[0][:] = 0.0
        if self.error is None and not self.waiting and self.report is not None:
            try:
                x, f, g = arguments[:3]
                off = self.nlp.violation(x, g)
                self.report(Iterate(self.iteration, x.copy(), float(f[0]), off))
            except BaseException as error:
                self.error = error
        self.iteration += 1
        if self.error is not None or self.waiting:
            results[0][:] = 1.0
        return 0


def _fill(result: FloatArray, value: Callable[[], Any]) -> None:
    """Compute and write an output unless it is not wanted."""
    if len(result):
        result[:] = value()


def _summed(place: IntArray, entries: FloatArray, size: int) -> FloatArray:
    return np.asarray(np.bincount(place, entries, minlength=size), dtype=np.float64)


def _compressed(
    rows: IntArray, columns: IntArray, height: int, width: int
) -> tuple[ca.Sparsity, IntArray]:
    """CasADi's column-compressed pattern and where in it each entry goes."""
    keys, place = np.unique(columns * np.int64(max(height, 1)) + rows, return_inverse=True)
    column, row = np.divmod(keys, max(height, 1))
    starts = np.searchsorted(column, np.arange(width + 1))
    return ca.Sparsity(height, width, starts.tolist(), row.tolist()), place.ravel()
