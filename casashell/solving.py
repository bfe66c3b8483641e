"""The front door: `solve` takes a problem to a certified result."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from casashell.engine.threads import one_thread
from casashell.inverse.advice import FREE_FORCE, explain, status_of
from casashell.inverse.certificate import certify, no_certificate
from casashell.inverse.methods import METHODS, PRESETS, STEP2, Choice, StepTwoMethod
from casashell.inverse.metric_mode import METRIC_ONLY, NATURALS, MetricMode, metric_quality
from casashell.inverse.outcome import Outcome, PieceSolver
from casashell.inverse.piece import Piece, split
from casashell.inverse.quality import assess
from casashell.inverse.warm_start import WarmStart
from casashell.metric import Metric, laid_out, with_metric
from casashell.problem import Problem
from casashell.result import Certificate, Result, Step
from casashell.status import Status
from casashell.typing import AnyArray, ArrayLike, FloatArray

Callback = Callable[[Step], None]


@dataclass
class _Run:
    """What a solve has gathered so far; survives an interrupt."""

    problem: Problem
    method: str
    callback: Callback | None
    started: float = field(default_factory=time.perf_counter)
    history: list[Step] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)
    solvers: list[PieceSolver] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    timings: dict[str, float] = field(default_factory=dict)
    interrupted: bool = False
    mode: MetricMode | None = None

    def report(self, step: Step) -> None:
        """Record a step and pass it on."""
        stamped = replace(step, seconds=time.perf_counter() - self.started)
        self.history.append(replace(stamped, rest=None, pose=None))
        if self.callback is not None:
            rest, pose = self._whole(step.rest), self._whole(step.pose)
            self.callback(replace(stamped, rest=rest, pose=pose))

    def _whole(self, shape: FloatArray | None) -> FloatArray | None:
        """Vertices (V,3) with those of the piece that is being solved, the others at the target."""
        if shape is None:
            return None
        piece = self.pieces[len(self.solvers) - 1]
        whole = self.problem.target.vertices.copy()
        whole[piece.vertices] = shape + piece.origin
        return whole

    def clock(self, name: str, begin: float) -> float:
        """Add the time since ``begin`` to a part; the time now."""
        now = time.perf_counter()
        self.timings[name] = self.timings.get(name, 0.0) + now - begin
        return now


def solve(
    problem: Problem,
    method: str = "auto",
    *,
    step2: StepTwoMethod = "ipopt",
    preset: str = "scaled",
    prefer: ArrayLike | None = None,
    natural: str = "mesh",
    start: Result | None = None,
    callback: Callback | None = None,
    interpreted: bool = False,
) -> Result:
    """Natural shape and contact forces for which the target of ``problem`` is a stable equilibrium.

    method       "direct": Newton on the natural shape along the load path; "two-step": Algorithm 1
                 of Ly 2018; "nlp": one nonlinear program at the target; "free-pose": the closest
                 stable pose when the target cannot be held; "auto": the cheapest that works
    step2        second step of "two-step": "ipopt", a program with cone constraints, or "bfgs",
                 descent on G_K
    preset       schedule and stopping rules of "two-step": "scaled" with the scene, or "paper"
    prefer       (V,3) m, a natural shape that the answer stays near where contact forces leave a
                 choice: a flat sheet, a pattern, an old version; where it lies does not matter
    natural      "mesh": natural positions; "metric": also natural lengths and angles, in
                 ``Result.metric``, and those alone where no natural mesh is found: softer materials
                 can hold the target then
    start        an earlier result of the same mesh, with another material, weight or contacts: methods
                 "auto" and "direct" try its natural shape and forces first
    callback     called with a `Step` at every iteration; an exception from it ends the solve
    interpreted  run kernels by CasADi's virtual machine even when there is a C compiler

    A KeyboardInterrupt ends the solve with what it has and status INTERRUPTED.  A solve that fails
    returns its best attempt with a status and advice; `Result.require` turns that into an exception.
    Raises ValueError for an unknown method, second step, preset or kind of natural shape, a preferred
    shape that does not fit the mesh, a start of another mesh or for another method, and energies that
    cannot take a metric when one is asked for.
    """
    if natural not in NATURALS:
        raise ValueError(f"natural must be one of {', '.join(NATURALS)}; got '{natural}'")
    earlier = None if start is None else WarmStart(start, problem)
    choice = Choice(method, step2, preset, _preferred(problem, prefer), earlier)
    run = _Run(problem, method, callback)
    run.mode = MetricMode(problem) if natural == "metric" else None
    with one_thread():
        try:
            _solve_pieces(run, choice, interpreted)
        except KeyboardInterrupt:
            run.interrupted = True
        return _finish(run)


def _solve_piece(run: _Run, piece: Piece, choice: Choice) -> None:
    """Natural mesh of a piece, or its metric when that is wanted and there is no mesh.

    A metric that holds the target itself comes before "auto" looks for a pose near by.
    """
    first = choice
    if run.mode is not None and choice.method == "auto":
        first = replace(choice, method="direct")
    run.solvers.append(first.solver(piece, run.report))
    outcome = run.solvers[-1].run()
    if run.mode is None or outcome.good or outcome.obstruction is not None:
        return
    if not run.mode.solve(len(run.solvers) - 1, piece, run.report) and first is not choice:
        run.solvers[-1] = choice.solver(piece, run.report)
        run.solvers[-1].run()


def _solve_pieces(run: _Run, choice: Choice, interpreted: bool) -> None:
    problem = run.problem
    begin = time.perf_counter()
    contacts = problem.contacts
    begin = run.clock("contacts", begin)
    run.pieces = list(split(problem, interpreted=interpreted))
    if not interpreted and not all(piece.assembly.compiled for piece in run.pieces):
        run.notes.append(
            "no C compiler: kernels are interpreted (about ten times slower derivatives)"
        )
    begin = run.clock("kernels", begin)
    if len(run.pieces) > 1:
        run.notes.append(f"{len(run.pieces)} independent parts, each solved by itself")
    if len(contacts) == 0:
        run.notes.append("no contacts: no contact forces to choose")
    elif (contacts.friction == 0.0).any():
        run.notes.append(
            "some contacts have no friction: they hold along their normal only, and stability "
            "against sliding along the obstacle is not part of the certificate"
        )
    for piece in run.pieces:
        _solve_piece(run, piece, choice)
    run.clock("solve", begin)


def _preferred(problem: Problem, prefer: ArrayLike | None) -> FloatArray | None:
    if prefer is None:
        return None
    shape, count = np.asarray(prefer, dtype=np.float64), len(problem.target.vertices)
    if shape.shape != (count, 3):
        raise ValueError(
            f"prefer must have one position a vertex of the target, shape ({count}, 3), "
            f"got {shape.shape}"
        )
    wrong = np.flatnonzero(~np.isfinite(shape).all(axis=1))
    if wrong.size:
        raise ValueError(f"prefer: vertex {int(wrong[0])} is not finite")
    return shape


def _gathered(
    run: _Run, *, in_place: bool = True
) -> tuple[FloatArray, FloatArray, FloatArray, list[Outcome]]:
    """Natural shape, pose and contact forces of the whole mesh from those of the pieces.

    in_place  False leaves natural shapes near the origin, where their coordinates round least
    """
    target, contacts = run.problem.target.vertices, run.problem.contacts
    rest, pose, forces = target.copy(), target.copy(), np.zeros((len(contacts), 3))
    outcomes = []
    shift = np.zeros(3) if in_place or not run.pieces else run.pieces[0].origin
    for piece, solver in zip(run.pieces, run.solvers, strict=False):
        outcome = solver.salvage() if run.interrupted else solver.best
        outcomes.append(outcome)
        rest[piece.vertices] = outcome.rest + (piece.origin - shift)
        if outcome.pose is not piece.target:
            pose[piece.vertices] = outcome.pose + piece.origin
        mine = np.isin(contacts.vertices, piece.vertices)
        forces[mine] = outcome.contact_forces
    return rest, pose, forces, outcomes


def _finish(run: _Run) -> Result:
    problem, contacts = run.problem, run.problem.contacts
    rest, pose, contact_forces, outcomes = _gathered(run)
    metric = None
    if run.mode is not None:
        metric = run.mode.metric(run.pieces, rest)
        rest, pose, contact_forces = run.mode.applied(run.pieces, rest, pose, contact_forces)
    begin = time.perf_counter()
    try:
        certificate, forces = _certificate(run, rest, pose, contact_forces, metric)
    except KeyboardInterrupt:
        run.interrupted = True
        certificate, forces = no_certificate(problem.target), np.full_like(rest, np.nan)
    if (certificate.free_force or 0.0) > FREE_FORCE and outcomes and all(o.good for o in outcomes):
        # Stiff slivers far from the origin: rounding the coordinates of the natural shape alone
        # upsets the balance.  It is defined up to a rigid motion, so bring it near the origin.
        run.notes.append(
            "natural shape moved to the origin: at the target's place the rounding of its coordinates "
            f"leaves {certificate.free_force:.1e} of a nodal weight"
        )
        rest, _, _, _ = _gathered(run, in_place=False)
        metric = None if run.mode is None else run.mode.metric(run.pieces, rest)
        certificate, forces = _certificate(run, rest, pose, contact_forces, metric)
    begin = run.clock("certificate", begin)
    quality = metric_quality(problem.target, metric, assess(problem.target, rest))
    run.clock("quality", begin)
    status, advice = _verdict(run, certificate, outcomes)
    material: dict[str, AnyArray] = {}
    for term in problem.energies:
        material.update(term.material)
    if problem.friction is not None:
        material["vertex_friction"] = np.asarray(problem.friction)
    sources = [solver.notes for solver in run.solvers] + ([run.mode.notes] if run.mode else [])
    for notes in sources:
        run.notes += [note for note in notes if note not in run.notes]
    return Result(
        status=status,
        advice=advice,
        method=run.method,
        target=problem.target,
        rest=rest,
        pose=pose,
        contacts=contacts,
        pinned=np.asarray(problem.pinned),
        contact_forces=contact_forces,
        forces=forces,
        material=material,
        certificate=certificate,
        quality=quality,
        obstacles=problem.obstacles,
        contact_tolerance=problem.tolerance,
        history=tuple(run.history),
        notes=tuple(run.notes),
        seconds=time.perf_counter() - run.started,
        iterations=sum(s.iterations for s in run.solvers),
        factorizations=sum(s.factorizations for s in run.solvers),
        timings=dict(run.timings),
        metric=metric,
        energies=problem.energies,
    )


def _certificate(
    run: _Run,
    rest: FloatArray,
    pose: FloatArray,
    contact_forces: FloatArray,
    metric: Metric | None,
) -> tuple[Certificate, FloatArray]:
    problem = run.problem
    energies = problem.energies
    if metric is not None and not metric.embedded:
        energies = with_metric(energies, problem.target, laid_out(problem.target, metric))
    return certify(
        energies,
        problem.target.vertices,
        pose,
        rest,
        problem.contacts,
        contact_forces,
        np.asarray(problem.pinned),
        float(problem.target.mean_edge_length),
    )


def _verdict(run: _Run, certificate: Certificate, outcomes: list[Outcome]) -> tuple[Status, str]:
    """Status and advice: the certificate decides, the solvers only explain a failure."""
    status = status_of(certificate)
    found = {} if run.mode is None else run.mode.found
    if status.certified:
        return status, METRIC_ONLY if found else explain(status, run.problem, None, None)
    if run.interrupted:  # also when only the certificate is missing
        return Status.INTERRUPTED, explain(Status.INTERRUPTED, run.problem, None, None)
    for number, (piece, outcome) in enumerate(zip(run.pieces, outcomes, strict=False)):
        if outcome.good or number in found:
            continue
        status = _failure(status, outcome)
        return status, explain(status, run.problem, piece, outcome)
    return status, explain(status, run.problem, None, None)


def _failure(status: Status, outcome: Outcome) -> Status:
    """What the solver knows beyond a certificate that failed."""
    if outcome.obstruction is not None:
        return Status.INFEASIBLE
    if status is Status.ITERATION_LIMIT:
        if outcome.rung in ("start", "nlp with slack"):
            return Status.CONE_VIOLATED
        if outcome.load < 1.0 and outcome.missing <= 1e-2:  # balanced at a smaller load
            return Status.TOO_SOFT
        if outcome.balanced and outcome.cone_margin < 0.0:
            return Status.CONE_VIOLATED
    return status


__all__ = ["METHODS", "NATURALS", "PRESETS", "STEP2", "Callback", "StepTwoMethod", "solve"]
