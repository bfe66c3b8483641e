"""Films read back: number, size, rate and content of pictures; nothing left behind on the way."""

from __future__ import annotations

import builtins
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from moving import moving

from casashell.io.movie import MovieUnavailable, Title, picked_frames, write_movie
from casashell.typing import AnyArray


@pytest.fixture
def drawing() -> None:
    for module in ("pyvista", "matplotlib", "PIL", "av"):
        pytest.importorskip(module, reason=f"{module} is not installed (extra viz)")


def film(path: Path) -> tuple[AnyArray, float]:
    """Pictures (n, height, width, 3) and their rate."""
    import av

    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        rate = float(stream.average_rate or 0.0)
        return np.stack(
            [picture.to_ndarray(format="rgb24") for picture in file.decode(stream)]
        ), rate


@pytest.mark.usefixtures("drawing")
def test_mp4_has_a_picture_for_every_frame(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    path = write_movie(
        moving(),
        tmp_path / "new" / "a.mp4",
        height=121,
        progress=lambda done, of: told.append((done, of)),
    )
    pictures, rate = film(path)
    assert len(pictures) == 6
    assert rate == 30.0
    assert pictures.shape[1] == 120  # even, as 4:2:0 needs
    assert pictures.shape[2] % 2 == 0
    assert told == [(n, 6) for n in range(1, 7)]
    blue = pictures[..., 2].astype(int) - pictures[..., 0]
    assert np.all((blue > 30).sum(axis=(1, 2)) > 200)  # the cloth is seen in every picture
    # It moves: pictures differ from the first more and more than by compression.
    assert np.abs(pictures[-1].astype(int) - pictures[0]).max() > 60
    assert [item.name for item in path.parent.iterdir()] == ["a.mp4"]


@pytest.mark.usefixtures("drawing")
def test_nothing_touches_the_rim_of_the_picture(tmp_path: Path) -> None:
    shells = replace(moving(), tracks=moving().tracks[:2], title=" ", captions=())
    pictures = film(write_movie(shells, tmp_path / "a.mp4", height=160))[0].astype(int)
    blue = pictures[..., 2] - pictures[..., 0] > 30
    for rim in (blue[:, 0], blue[:, -1], blue[:, :, 0], blue[:, :, -1]):
        assert not rim.any()


def test_words_are_above_the_picture() -> None:
    """Title and captions have a band of their own; the picture below it is untouched."""
    pytest.importorskip("matplotlib")
    told = replace(moving(), title="A title", captions=tuple("a caption" for _ in moving().times))
    title = Title(told, 200)
    picture = np.full((200 - title.band, 300, 3), 240, dtype=np.uint8)
    picture[0, 10:] = 17  # a shell that reaches the rim
    made = title.over(picture, 0)
    assert made.shape == (200, 300, 3)
    assert np.array_equal(made[title.band :], picture)
    assert (made[: title.band] < 100).any()
    assert (made[title.band - 2 : title.band] == 240).all()


@pytest.mark.usefixtures("drawing")
def test_gif_has_a_picture_for_every_frame(tmp_path: Path) -> None:
    from PIL import Image

    path = write_movie(moving(frames=5), tmp_path / "a.gif", fps=30.0, height=100)
    with Image.open(path) as image:
        assert image.n_frames == 5  # type: ignore[attr-defined]
        durations = []
        for frame in range(5):
            image.seek(frame)
            durations.append(image.info["duration"])
    # 1/30 s is not a whole number of hundredths: the fifth picture starts at 4/30 s, rounded.
    assert sum(durations[:-1]) == 130
    assert set(durations) == {30, 40}


def test_the_frame_nearest_in_time_is_shown() -> None:
    animation = moving(frames=7)
    assert picked_frames(animation, 30.0).tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert picked_frames(animation, 15.0).tolist() == [0, 2, 4, 6]
    assert picked_frames(animation, 30.0, speed=3.0).tolist() == [0, 3, 6]
    assert len(picked_frames(animation, 30.0, speed=0.5)) == 13
    # Six frames at 25 pictures a second: the film ends with the last frame, a little later.
    assert picked_frames(animation, 25.0).tolist() == [0, 1, 2, 4, 5, 6]
    uneven = replace(animation, times=np.array([1.0, 1.1, 1.2, 1.3, 1.4, 1.9, 2.0]))
    assert picked_frames(uneven, 10.0).tolist() == [0, 1, 2, 3, 4, 4, 4, 5, 5, 5, 6]
    alone = replace(
        animation,
        times=np.zeros(1),
        tracks=tuple(
            replace(track, positions=track.positions[:1], lines=None, contact=None)
            for track in animation.tracks
        ),
        captions=(),
        series={},
    )
    assert picked_frames(alone, 30.0).tolist() == [0]


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("a.avi", {}, r"\.mp4 or \.gif"),
        ("a.mp4", {"fps": 0.0}, "fps must be positive"),
        ("a.mp4", {"speed": float("nan")}, "speed must be positive"),
        ("a.mp4", {"height": 5}, "64 to 4320"),
    ],
)
def test_a_wrong_wish_is_refused(
    tmp_path: Path, name: str, change: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        write_movie(moving(), tmp_path / name, **change)


@pytest.mark.usefixtures("drawing")
@pytest.mark.parametrize("name", ["a.mp4", "a.gif"])
def test_an_interrupted_film_leaves_the_old_one(tmp_path: Path, name: str) -> None:
    def stop(done: int, of: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    (tmp_path / name).write_text("old")
    with pytest.raises(FileExistsError):
        write_movie(moving(), tmp_path / name)
    with pytest.raises(KeyboardInterrupt):
        write_movie(moving(), tmp_path / name, height=64, overwrite=True, progress=stop)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "old"


@pytest.mark.parametrize("missing", ["av", "PIL", "pyvista"])
@pytest.mark.usefixtures("drawing")
def test_a_missing_package_is_named_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.split(".")[0] == missing:
            raise ImportError(f"No module named '{missing}'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    told: list[int] = []
    with pytest.raises(MovieUnavailable, match=rf"'{missing}'.*extra 'viz'"):
        write_movie(moving(), tmp_path / "a.mp4", progress=lambda done, of: told.append(done))
    assert not told
    assert list(tmp_path.iterdir()) == []
