"""The report: complete, escaped, self-contained, also when things are missing."""

from __future__ import annotations

import base64
import builtins
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_result import failed, sample

from casashell.io.report import write_report
from casashell.io.report_chart import history_chart
from casashell.io.report_view import SHELL_FACES, view_data
from casashell.result import Result
from casashell.status import Status

plotly = pytest.mark.usefixtures("viewer")


@pytest.fixture
def viewer() -> None:
    pytest.importorskip("plotly", reason="plotly is not installed (extra viz)")


@pytest.fixture
def no_plotly(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.split(".")[0] == "plotly":
            raise ImportError("No module named 'plotly'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)


class Page(HTMLParser):
    """Text outside scripts and styles, every attribute, and whether tags are balanced."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.text: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.open: list[str] = []
        self.feed(source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in ("meta", "input"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in ("script", "style"):
            self.text.append(data)


def page(result: Result, folder: Path, **options: Any) -> tuple[Page, str]:
    source = write_report(result, folder / "report.html", **options).read_text(encoding="utf-8")
    return Page(source), source


@pytest.mark.usefixtures("no_plotly")
def test_numbers_and_words_are_there(tmp_path: Path) -> None:
    read, _ = page(sample(), tmp_path)
    text = " ".join(read.text)
    assert read.open == []
    for expected in (
        "3.25e−12", "0.0125", "0.200", "12.5 N/m", "2.10e−7",  # certificate of the sample
        "≤ 1e−6", "✓ pass", "Nothing <to> do & enjoy.", "SOLVED",
        "10 %", "14.3°", "20 N", "0.2 kg/m²", "(0, −9.81, 0) m/s²", "1.50 N",
    ):  # fmt: skip
        assert expected in text, expected
    assert "✗ fail" not in text
    # All digits are kept for whoever hovers.
    assert ("td", "title", "3.25e-12") in read.attributes


@pytest.mark.usefixtures("no_plotly")
def test_everything_is_escaped(tmp_path: Path) -> None:
    read, source = page(sample(), tmp_path, title="<b>x</b> & $y")
    assert "<script>alert" not in source
    assert "ball <b>" not in source
    assert "done <i>" not in source
    assert "<b>x</b> & $y" in read.text
    assert "a note with <script>alert(1)</script>" in read.text


@pytest.mark.usefixtures("no_plotly")
def test_report_without_plotly_says_how_to_get_the_view(tmp_path: Path) -> None:
    read, source = page(sample(), tmp_path)
    assert "pip install 'plotly" in " ".join(read.text)
    assert "<script" not in source
    assert len(source) < 50_000


@plotly
def test_nothing_is_loaded_from_elsewhere(tmp_path: Path) -> None:
    read, source = page(sample(), tmp_path)
    loads = [a for a in read.attributes if a[1] in ("src", "href", "srcset", "data", "action")]
    assert loads == []
    assert not re.search(r"@import|url\(", source[: source.index("<script")])
    policy = next(v for t, n, v in read.attributes if t == "meta" and "default-src" in v)
    assert "default-src 'none'" in policy
    assert "http" not in policy
    # Ours alone: plotly.js names addresses of maps it is never asked for.
    ours = Path("casashell/io/report_view.js")
    assert "http" not in (Path(__file__).parents[2] / ours).read_text(encoding="utf-8")


@plotly
def test_view_data_is_the_result(tmp_path: Path) -> None:
    result = replace(sample(0.9), rest=sample(0.9).rest + np.array([5.0, 0.0, 0.0]))
    _, source = page(result, tmp_path)
    found = re.search(r'id="view-data">(.*?)</script>', source, re.S)
    assert found is not None
    data = json.loads(found[1])

    def unpack(packed: dict[str, Any]) -> Any:
        flat = np.frombuffer(base64.b64decode(packed["d"]), dtype=f"<{packed['t']}")
        return flat.reshape(-1, packed["w"])

    shell = data["shell"]
    centre = result.target.vertices.mean(
        axis=0
    )  # the natural shape, nine tenths as large, is there
    wanted = centre + 0.9 * (result.target.vertices - centre)
    np.testing.assert_allclose(unpack(shell["natural"]), wanted, rtol=1e-6, atol=1e-7)
    np.testing.assert_array_equal(unpack(shell["faces"]), result.target.faces)
    np.testing.assert_allclose(unpack(shell["stretch"]), -10.0, rtol=1e-5)
    np.testing.assert_allclose(unpack(data["arrows"]["use"])[:, 0], [50.0, 200.0], rtol=1e-6)
    assert data["obstacles"][0]["name"] == "ball <b>&</b>"
    # Blue where compressed: the low end of the scale.
    red, _, blue = map(int, re.findall(r"\d+", data["maps"]["stretch"]["scale"][0][1]))
    assert blue > red
    assert data["up"] == [0.0, 1.0, 0.0]


@plotly
def test_large_mesh_is_thinned_and_the_file_stays_small(tmp_path: Path) -> None:
    large = sample(rows=225)  # 100 352 triangles
    read, source = page(large, tmp_path)
    assert len(source) < 8_000_000
    assert f"of {len(large.target.faces)} triangles" in " ".join(read.text)
    data = json.loads(view_data(large, (0.0, 1.0, 0.0))[0])
    count = len(base64.b64decode(data["shell"]["faces"]["d"])) // 12
    assert 0.3 * SHELL_FACES < count <= SHELL_FACES


@plotly
@pytest.mark.parametrize("up", [None, (0, 0, 1), (1.0, 2.0, 3.0)])
def test_result_without_contacts_material_and_certificate(tmp_path: Path, up: Any) -> None:
    read, _ = page(failed(), tmp_path, up=up)
    text = " ".join(read.text)
    assert "not computed" in text
    assert "no contacts" in text
    assert "ITERATION_LIMIT" in text
    assert "✓ pass" not in text
    assert ("div", "class", "verdict red") in read.attributes


def test_natural_shape_that_is_not_finite_is_still_reported(tmp_path: Path) -> None:
    rest = np.full_like(sample().rest, np.nan)
    broken = replace(sample(), status=Status.NONFINITE, rest=rest)
    read, source = page(broken, tmp_path)
    assert "not finite" in " ".join(read.text)
    assert "<script" not in source


@pytest.mark.usefixtures("no_plotly")
@pytest.mark.parametrize("status", list(Status))
def test_every_status_has_words_and_a_tone(tmp_path: Path, status: Status) -> None:
    read, _ = page(replace(sample(), status=status), tmp_path)
    tones = [v.split()[1] for t, n, v in read.attributes if v.startswith("verdict ")]
    wanted = {Status.SOLVED: "green", Status.SOLVED_NEARBY: "amber", Status.INTERRUPTED: "amber"}
    assert tones == [wanted.get(status, "red")]


@pytest.mark.usefixtures("no_plotly")
def test_failed_lines_are_marked(tmp_path: Path) -> None:
    certificate = replace(sample().certificate, cone_margin=-0.5, min_eigenvalue_scaled=1e-9)
    read, _ = page(replace(sample(), certificate=certificate), tmp_path)
    # The cone, and both lines of the stiffness: 1e-9 is a neutral motion.
    assert " ".join(read.text).count("✗ fail") == 3


def test_chart_leaves_out_what_has_no_residual() -> None:
    assert history_chart(sample().history).count("<circle") == 2
    assert history_chart(sample().history[:2]) == ""


def test_up_without_direction_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="up must be"):
        write_report(sample(), tmp_path / "report.html", up=(0, 0, 0))
