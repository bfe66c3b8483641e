"""An animation as one HTML file that plays, turns and scrubs it without a network."""

from __future__ import annotations

import math
from html import escape
from importlib import resources
from pathlib import Path
from string import Template

from casashell.io.animation import Animation
from casashell.io.player_data import player_data
from casashell.io.staging import staged_file


def write_player(
    animation: Animation, path: Path, *, megabytes: float = 40.0, overwrite: bool = False
) -> Path:
    """Write the player as one self-contained ``.html`` file; return the path.

    megabytes  room for the positions; beyond it frames are left out evenly, and the page says so

    Positions are rounded to 1/65534 of the longest side of the box around each track's motion.
    ``#frame=N`` after the address opens the page paused at that frame.

    FileExistsError: the file is there and ``overwrite`` is False.  ValueError: another extension,
    or no room.
    """
    file = Path(path)
    if file.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"{file}: a player ends in .html")
    if not (math.isfinite(megabytes) and megabytes > 0):
        raise ValueError(f"megabytes must be positive, got {megabytes}")
    with staged_file(file, overwrite=overwrite) as temporary:
        data, remark = player_data(animation, megabytes)
        page = Template(_resource("player.html")).substitute(
            title=escape(animation.title),
            remark=escape(remark),
            # "</" would end the script element wherever it stood.
            data=data.replace("</", "<\\/"),
            style=_resource("player.css"),
            scripts="\n".join(map(_resource, ("player_geometry.js", "player_gl.js", "player.js"))),
        )
        temporary.write_text(page, encoding="utf-8")
    return file


def _resource(name: str) -> str:
    return resources.files("casashell.io").joinpath(name).read_text(encoding="utf-8")
