"""One HTML file that plays the relit frames of a sequence; a folder to serve where one file would be too large.

The viewer of the page shows one frame after the other, each a compressed PLY. In the file a frame is stored as the
bytes in which it differs from the one before, where that is shorter: what rests takes next to nothing.
"""

import gzip
import json
import os
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from splat2mesh.base.arrays import Indices, Matrix4
from splat2mesh.base.outputs import staged_file
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import write_splats
from splat2mesh.splats.splats import Splats

from ..light.environment import Environment
from .lights import light_of, rgbe
from .live import first_view, spatial_order
from .page import FOLDER, INDEX, MOST_PACKED, PAGE, page_text, script_of

FRAMES = "frames.json"
"""What the folder of such a page says of its frames."""

MOST_UNPACKED = 400_000_000
"""Bytes of all frames unpacked above which the page is a folder: it reads frames as it plays."""

_SKY = "sky.rgbe"
_LIBRARY, _SCRIPTS = ("primaries", "light", "framing"), ("layout", "host", "play")


class Played(NamedTuple):
    """What a page shows beside its frames. scene: of the first. sky: the Environment behind them or None, at a display
    value per unit of its radiance. fps: frames a second. title: the name of the sequence."""

    scene: Scene
    sky: Environment | None
    exposure: float
    fps: float
    title: str


class _Frames:
    """Writes frames into a folder, and what differs from one to the next. entries: file of each, and whether it is
    stored so. packed: by name, until they are too many, then None."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._before = folder, b""
        self.entries: list[dict[str, Any]] = []
        self.packed: dict[str, bytes] | None = {}
        self._sizes = np.zeros(2)

    def add(self, splats: Splats) -> None:
        name = f"{len(self.entries):04d}.compressed.ply"
        write_splats(self._folder / name, splats, "compressed.ply")
        content, before = (self._folder / name).read_bytes(), self._before
        self._before, differs = content, False
        if self.packed is not None:
            kept = content, len(gzip.compress(content, 6))
            if len(before) == len(content):
                change = (np.frombuffer(content, np.uint8) ^ np.frombuffer(before, np.uint8)).tobytes()
                smaller = change, len(gzip.compress(change, 6))
                differs = smaller[1] < kept[1]
                kept = smaller if differs else kept
            self._sizes += (4 / 3 * kept[1], len(content))
            self.packed[name] = kept[0]
            if (self._sizes > (MOST_PACKED, MOST_UNPACKED)).any():
                self.packed = None
        self.entries.append({"file": name, "differs": differs})


def write_player(folder: str | os.PathLike[str], frames: Iterable[Splats], played: Played) -> list[str]:
    """Write a page of frames, in their order, into a folder that exists; returns the names of its files. It replaces an
    earlier page there."""
    folder, most, count = Path(folder), 0, 0
    order: Indices = np.zeros(0, np.int64)
    views: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(dir=folder) as name:
        staging = Path(name) / FOLDER
        staging.mkdir()
        written = _Frames(staging)
        for splats in frames:
            order = order if len(order) == len(splats) else spatial_order(splats)
            if not views or len(splats) == count:  # rows of the background are of the first frame
                count = len(splats)
                views.append(first_view(played.scene, splats, played.scene.vertices))
            written.add(splats.take(order))
            most = max(most, len(splats))
        frame: Matrix4 = np.asarray(played.scene.scene_from_splat, np.float64)
        data: dict[str, Any] = {"fps": played.fps, "splats": most, "scene_from_splat": frame.tolist()}
        data["camera"] = _joined(views)
        data["sky"], extra = _sky(played)
        data["packed"] = written.packed is not None
        data["frames"] = [{**each, "differs": each["differs"] and data["packed"]} for each in written.entries]
        page = page_text(played.title, data, script_of(_LIBRARY, _SCRIPTS), {**(written.packed or {}), **extra})
        shutil.rmtree(folder / FOLDER, ignore_errors=True)
        if written.packed is not None:
            with staged_file(folder / PAGE) as path:
                path.write_text(page, "utf-8", "replace")
            return [PAGE]
        (folder / PAGE).unlink(missing_ok=True)
        (staging / INDEX).write_text(page, "utf-8", "replace")
        (staging / FRAMES).write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
        for each, content in extra.items():
            (staging / each).write_bytes(content)
        staging.rename(folder / FOLDER)
    return [f"{FOLDER}/{each}" for each in (INDEX, FRAMES, *(each["file"] for each in written.entries), *extra)]


def _joined(views: list[dict[str, Any]]) -> dict[str, Any]:
    """The first view, that of an object so wide that all frames fit into it."""
    if not views or "bounds" not in views[0]:
        return views[0] if views else {}
    low, high = zip(*(view["bounds"] for view in views), strict=True)
    return {**views[0], "bounds": [np.min(low, axis=0).tolist(), np.max(high, axis=0).tolist()]}


def _sky(played: Played) -> tuple[dict[str, Any] | None, dict[str, bytes]]:
    """The entry of what is behind the splats, or None, and its file."""
    if played.sky is None:
        return None, {}
    turn = played.sky.rotation_deg
    image = light_of(played.sky.rotated(-turn), played.exposure).image
    return {"file": _SKY, "exposure": played.exposure, "turn": turn}, {_SKY: rgbe(image).tobytes()}
