"""One HTML file that tells a result: verdict, certificate, quality, scene, history and a 3-D view."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from string import Template
from typing import Final

import numpy as np

from casashell.io.camera import directions
from casashell.io.labels import STATUS_WORDS, engineering
from casashell.io.report_chart import history_chart
from casashell.io.report_tables import (
    Line,
    certificate_lines,
    contact_rows,
    history_rows,
    key_numbers,
    quality_lines,
    scene_lines,
    tone,
)
from casashell.result import Result

__all__ = ["write_report"]

_INSTALL: Final = "pip install 'plotly>=5.20'"
_HISTORY_ROWS: Final = 400
_VIEWS: Final = (
    ("target", "Target"),
    ("forces", "Contact forces"),
    ("natural", "Natural shape"),
    ("stretch", "Stretch"),
    ("bend", "Bending"),
)
_OPTIONS: Final = (("obstacle", "Obstacle"), ("edges", "Mesh edges"), ("outline", "Target's rims"))


def write_report(
    result: Result,
    path: Path,
    *,
    title: str = "Natural shape",
    up: Sequence[float] | None = None,
) -> Path:
    """Write the report as one self-contained HTML file at ``path``; return the path.

    title   heading
    up      up axis of the 3-D view; against gravity by default, y without gravity

    Without plotly, or when the natural shape is not finite, the 3-D view is left out and the
    report says why.  ValueError: ``up`` has no direction.
    """
    upward = _upward(result) if up is None else up
    directions(upward)
    view, scripts, remarks = _view(result, upward)
    page = _template("report_template.html").substitute(
        title=escape(title),
        subtitle=escape(f"Method {result.method}"),
        tone=tone(result.status),
        status=escape(result.status.value),
        words=escape(STATUS_WORDS[result.status]),
        advice=escape(result.advice),
        keys="".join(
            f"<div><b>{escape(value)}</b><span>{escape(words)}</span></div>"
            for value, words in key_numbers(result)
        ),
        view=view,
        sections="".join(_sections(result, remarks)),
        footer=escape(f"Written by casashell {_version()}. Lengths in metres, axes of the input."),
        scripts=scripts,
    )
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(page, encoding="utf-8")
    return file


def _sections(result: Result, remarks: Sequence[str]) -> Iterable[str]:
    notes = (*result.notes, *remarks)
    if notes:
        items = "".join(f"<li>{escape(note)}</li>" for note in notes)
        yield _section("Notes", f"<ul>{items}</ul>")
    f0 = engineering(result.certificate.f0, "N")
    h = engineering(result.certificate.h, "m")
    yield _section(
        "Certificate",
        _checks(certificate_lines(result), ("What", "Value", "Wanted", ""), proof=True)
        + f'<p class="hint">f0 = {escape(f0)}, mean weight of a vertex; h = {escape(h)}, mean edge '
        f"length. Computed from the two shapes by code that shares nothing with the solver "
        f"({escape(result.certificate.evaluator)}).</p>",
    )
    quality = _section(
        "Natural shape", _checks(quality_lines(result), ("What", "Value", "Wanted", ""))
    )
    scene = _section("Scene and material", _checks(scene_lines(result), ()))
    yield f'<div class="two">{quality}{scene}</div>'
    if result.obstacles:
        head = ("obstacle", "kind", "friction μ", "contacts", "normal force", "friction in use")
        yield _section("Contact", _table(head, contact_rows(result)))
    if result.history or result.timings:
        yield _section("Solve", _solve(result))


def _solve(result: Result) -> str:
    """Chart, steps and timings."""
    count = f"{result.iterations} iterations, {result.factorizations} factorizations"
    parts = [f"<p>{count}, {escape(engineering(result.seconds, 's'))}.</p>"]
    parts.append(history_chart(result.history))
    if result.history:
        rows = history_rows(result)
        left_out = len(rows) - _HISTORY_ROWS
        more = f", the last {_HISTORY_ROWS}" if left_out > 0 else ""
        head = ("stage", "load", "iteration", "residual", "time", "note")
        parts.append(
            f"<details><summary>All {len(rows)} steps{more}</summary>"
            f"{_table(head, rows[-_HISTORY_ROWS:])}</details>"
        )
    if result.timings:
        times = [(name, engineering(time, "s")) for name, time in result.timings.items()]
        parts.append(_table(("part", "time"), times))
    return "".join(parts)


def _view(result: Result, up: Sequence[float]) -> tuple[str, str, tuple[str, ...]]:
    """HTML of the 3-D view, its scripts, and remarks on what it leaves out."""
    arrays = (result.rest, result.contact_forces)
    if not all(np.all(np.isfinite(array)) for array in arrays):
        return _no_view("The natural shape has numbers that are not finite."), "", ()
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        return _no_view(f"It needs plotly: {_INSTALL}"), "", ()
    # Later than the check for plotly: the data is not worth computing without it.
    from casashell.io.report_view import view_data

    data, remarks = view_data(result, up)
    buttons = "".join(
        f'<button type="button" data-view="{key}" aria-pressed="false">{words}</button>'
        for key, words in _VIEWS
    )
    boxes = "".join(
        f'<label><input type="checkbox" data-option="{key}" checked> {words}</label>'
        for key, words in _OPTIONS
    )
    html = _section(
        "3-D view",
        f'<div class="bar">{buttons}{boxes}</div>'
        '<div id="view"><noscript>The 3-D view needs JavaScript.</noscript></div>'
        '<p class="hint"><span id="view-legend"></span> Drag to turn, scroll to zoom, hover for '
        "values.</p>",
    )
    # "</" would end the script element wherever it stood.
    safe = data.replace("</", "<\\/")
    scripts = (
        f"<script>{get_plotlyjs()}</script>"
        f'<script type="application/json" id="view-data">{safe}</script>'
        f"<script>{_resource('report_view.js')}</script>"
    )
    return html, scripts, remarks


def _no_view(reason: str) -> str:
    return _section("3-D view", f'<p class="hint">Not in this report. {escape(reason)}</p>')


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{body}</section>"


def _checks(lines: Sequence[Line], head: Sequence[str], *, proof: bool = False) -> str:
    """Table of lines, the columns for what is wanted only where something is.

    What a proof asks for fails when it is not so; anything else is pointed out.
    """
    asked = any(line.wanted for line in lines)
    bad = ("fail", "✗ fail") if proof else ("warn", "! look")
    rows = []
    for line in lines:
        words = f"<small>{escape(line.words)}</small>" if line.words else ""
        exact = f' title="{escape(line.exact)}"' if line.exact else ""
        cells = f'<td>{escape(line.name)}{words}</td><td class="n"{exact}>{escape(line.value)}</td>'
        if asked:
            mark = {True: ("pass", "✓ pass" if proof else "✓"), False: bad, None: ("open", "–")}
            kind, sign = mark[line.passed]
            if not line.wanted:
                sign = ""
            cells += f'<td class="n">{escape(line.wanted)}</td><td class="{kind}">{sign}</td>'
        rows.append(f"<tr>{cells}</tr>")
    heading = "".join(f"<th>{escape(words)}</th>" for words in head)
    above = f"<thead><tr>{heading}</tr></thead>" if heading else ""
    return f'<div class="scroll"><table class="checks">{above}<tbody>{"".join(rows)}</tbody></table></div>'


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    heading = "".join(f"<th>{escape(words)}</th>" for words in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return (
        f'<div class="scroll"><table><thead><tr>{heading}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _upward(result: Result) -> tuple[float, float, float]:
    """Against gravity, y when there is none."""
    gravity = result.material.get("gravity")
    if gravity is None or not np.any(gravity):
        return 0.0, 1.0, 0.0
    x, y, z = (-float(component) for component in gravity)
    return x, y, z


def _resource(name: str) -> str:
    return resources.files("casashell.io").joinpath(name).read_text(encoding="utf-8")


def _template(name: str) -> Template:
    return Template(_resource(name))


def _version() -> str:
    try:
        return version("casashell")
    except PackageNotFoundError:
        return "(from source)"
