"""The player's page: what it embeds against the animation, its size, and how a browser shows it."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from moving import moving

from casashell.io.animation import Animation
from casashell.io.packing import STEPS
from casashell.io.player import write_player
from casashell.io.player_data import affine_motion, kept_frames
from casashell.typing import AnyArray, FloatArray

_TYPES = {"i2": "<i2", "u1": "u1", "i4": "<i4", "f4": "<f4"}


def embedded(page: Path) -> dict[str, Any]:
    """The data of the page, as the browser parses it."""
    text = page.read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert found
    data: dict[str, Any] = json.loads(found.group(1))
    return data


def unpacked(packed: dict[str, Any]) -> AnyArray:
    return np.frombuffer(base64.b64decode(packed["d"]), dtype=_TYPES[packed["t"]])


def points(packed: dict[str, Any], frames: int) -> FloatArray:
    whole = unpacked(packed).reshape(frames, -1, 3)
    return np.asarray(packed["center"]) + packed["step"] * whole.astype(np.float64)


def test_positions_are_right_to_half_a_step(tmp_path: Path) -> None:
    animation = moving()
    data = embedded(write_player(animation, tmp_path / "a.html"))
    assert data["times"] == animation.times.tolist()
    assert data["captions"] == list(animation.captions)
    assert data["series"][0]["values"] == [None, 0.9, 0.8, 0.7, 0.6, 0.5]
    cloth, packed = animation.tracks[0], data["tracks"][0]
    assert cloth.lines is not None
    assert cloth.contact is not None
    side = float(np.ptp(cloth.positions.reshape(-1, 3), axis=0).max())
    half = 0.5 * side / STEPS
    assert packed["points"]["step"] == pytest.approx(2 * half, rel=1e-12)
    # Rounding to even may take the last bit of a double more than half.
    error = np.abs(points(packed["points"], 6) - cloth.positions)
    assert error.max() <= half * (1 + 1e-9)
    assert error.max() > 0.1 * half
    lines = points(packed["lines"], 6).reshape(cloth.lines.shape)
    assert np.abs(lines - cloth.lines).max() <= half * (1 + 1e-9)
    bits = np.unpackbits(unpacked(packed["contact"]), count=cloth.contact.size)
    assert np.array_equal(bits.reshape(cloth.contact.shape), cloth.contact)
    assert np.array_equal(unpacked(packed["faces"]).reshape(-1, 3), cloth.faces)


def test_a_turning_body_is_one_shape_and_its_motion(tmp_path: Path) -> None:
    animation = moving(frames=40)
    block = animation.tracks[1]
    packed = embedded(write_player(animation, tmp_path / "a.html"))["tracks"][1]
    first = points(packed["points"], 1)[0] - packed["points"]["center"]
    motion = unpacked(packed["motion"]).reshape(40, 4, 3)
    moved = np.column_stack([first, np.ones(len(first))]) @ motion
    # A step: half for the first frame's rounding, half for the fit.
    assert np.abs(moved - block.positions).max() <= packed["points"]["step"]
    assert affine_motion(animation.tracks[0]) is None
    still = embedded(tmp_path / "a.html")["tracks"][2]
    assert still["still"]
    assert still["motion"] is None


def test_600_frames_of_900_vertices_stay_below_10_megabytes(tmp_path: Path) -> None:
    page = write_player(moving(frames=600, columns=450), tmp_path / "a.html")
    assert page.stat().st_size < 10e6
    assert len(embedded(page)["frames"]) == 600


def test_frames_are_left_out_evenly_when_there_is_no_room(tmp_path: Path) -> None:
    animation = moving(frames=200, columns=100)
    page = write_player(animation, tmp_path / "a.html", megabytes=0.2)
    data = embedded(page)
    kept = np.array(data["frames"])
    assert kept[0] == 0
    assert kept[-1] == 199
    assert np.ptp(np.diff(kept)) <= 1
    assert len(kept) < 200
    assert page.stat().st_size < 0.2e6 + 60e3  # the page itself takes the rest
    assert f"{len(kept)} of 200 frames" in page.read_text()
    assert data["times"] == animation.times[kept].tolist()
    assert np.array_equal(kept_frames(animation, 40.0), np.arange(200))


def test_the_page_asks_for_nothing_outside(tmp_path: Path) -> None:
    text = write_player(moving(), tmp_path / "a.html").read_text()
    assert "default-src 'none'" in text
    assert not re.search(r"(https?:)?//[a-z]+\.[a-z]|\bsrc=|@import|url\(", text)
    assert "<title>Strip &lt;/script&gt; &amp; block</title>" in text


def test_a_wrong_wish_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"\.html"):
        write_player(moving(), tmp_path / "a.mp4")
    with pytest.raises(ValueError, match="megabytes"):
        write_player(moving(), tmp_path / "a.html", megabytes=0.0)
    (tmp_path / "a.html").write_text("mine")
    with pytest.raises(FileExistsError):
        write_player(moving(), tmp_path / "a.html")
    assert (tmp_path / "a.html").read_text() == "mine"


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_a_browser_draws_it(tmp_path: Path, theme: str) -> None:
    image = pytest.importorskip("PIL.Image", reason="pillow is not installed (extra viz)")
    animation = all_in_contact()
    page = write_player(animation, tmp_path / "a.html")
    browse(
        page,
        f"frame=2&theme={theme}",
        "--window-size=900,600",
        f"--screenshot={tmp_path / 'a.png'}",
    )
    with image.open(tmp_path / "a.png") as picture:
        shown = np.asarray(picture.convert("RGB")).astype(int)
    corner = shown[60, 5]
    assert (corner.mean() > 200) == (theme == "light")
    stage = shown[50:480, :590]
    orange = (stage[..., 0] - stage[..., 2] > 40).sum()
    assert orange > 2000  # cloth in contact
    assert (np.abs(stage - corner).max(axis=2) > 20).sum() > 1.2 * orange  # the bodies too


def test_keys_move_through_time(tmp_path: Path) -> None:
    page = write_player(moving(frames=60), tmp_path / "a.html")
    script = """<script>
      const seen = [];
      const root = document.documentElement.dataset;
      const steps = ["ArrowRight", "ArrowRight", "End", "ArrowLeft", "Home", "ArrowLeft", "d", " "];
      function next() {
        seen.push(root.frame);
        if (seen.length > 8) { root.seen = seen.join(" ") + " " + root.theme; return; }
        const key = steps[seen.length - 1];
        document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
        setTimeout(next, 100);
      }
      setTimeout(next, 100);
    </script></body>"""
    # A headless browser that prints the page draws no frames of its own.
    clock = "<script>requestAnimationFrame = (f) => setTimeout(() => f(performance.now()), 10);</script>"
    text = page.read_text().replace("<body>", f"<body>{clock}").replace("</body>", script)
    page.write_text(text)
    shown = browse(page, "frame=2&theme=light", "--dump-dom")
    seen = re.findall(r'data-seen="([^"]*)"', shown)[0].split()
    assert seen[:8] == ["2", "3", "4", "59", "58", "0", "0", "0"]
    assert int(seen[8]) > 0  # it plays
    assert seen[9] == "dark"
    assert "data-failure" not in shown


def browse(page: Path, fragment: str, *flags: str) -> str:
    """What a headless browser prints for the page; skips without one."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no chromium or google-chrome on this machine")
    usual = (
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--enable-unsafe-swiftshader",
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        f"--user-data-dir={page.parent / 'profile'}",
        "--virtual-time-budget=3000",
    )
    command = [browser, *usual, *flags, f"{page.as_uri()}#{fragment}"]
    done = subprocess.run(command, check=True, capture_output=True, timeout=120, text=True)
    return done.stdout


def all_in_contact() -> Animation:
    animation = moving()
    cloth = animation.tracks[0]
    everywhere = np.ones(cloth.positions.shape[:2], dtype=bool)
    return replace(animation, tracks=(replace(cloth, contact=everywhere), *animation.tracks[1:]))
