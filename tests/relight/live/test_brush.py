"""The brush of the page, run by node: a ball before a wall, and the files that it keeps."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from live_scene import live_scene

from relight.live.bundle import ROWS_FILE
from relight.live.parts import LivePart, LiveParts
from relight.splats.kept_parts import kept_parts, next_name
from relight.splats.lit_part import LitPart, with_kept_lights
from relight.splats.part_spec import PartSpec, SplatFile
from splat2mesh.splats.formats import write_splats
from splat2mesh.splats.splats import Splats

ROOT = Path(__file__).parents[3]

SIZE = 400, 400

EYE, BALL = np.array([0.0, 0.0, 4.0]), np.array([0.0, 0.0, 1.5])

RIM = 70.7
"""Pixels from the middle of the ball to its edge."""

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")


def matrix():
    """(16,) columns first, from space to the clip space of a camera at EYE that looks along -z, 60 degrees wide."""
    focal, near, far = 1 / np.tan(np.radians(30)), 0.1, 100.0
    clip = np.diag([focal, focal, (far + near) / (near - far), 0.0])
    clip[2, 3], clip[3, 2] = 2 * far * near / (near - far), -1.0
    clip[:, 3] -= clip[:, :3] @ EYE
    return clip.T.ravel().tolist()


def pixels(places):
    """(N, 2) places in the picture."""
    away = places - EYE
    return SIZE[0] / 2 * (1 + away[:, :2] * [1, -1] / -away[:, 2:] / np.tan(np.radians(30)))


def painted(folder, **wish):
    wish = {"matrix": matrix(), "size": SIZE, **wish}
    script = ROOT / "tests/support/brush.mjs"
    command = ["node", script, ROOT / "relight/live/web", folder, json.dumps(wish)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def wall(tmp_path_factory):
    """(folder, places, kinds, rows in the file): 0 a wall at z = 0, 1 a ball of radius .5 before it, 2 fog between them
    and the camera. The part `door` is kept."""
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(1500, 3))
    ball = 0.5 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + BALL
    flat = np.concatenate([rng.uniform(-2, 2, (6000, 2)), np.zeros((6000, 1))], axis=1)
    places = np.concatenate([flat, ball, rng.uniform([-0.5, -0.5, 2.3], [0.5, 0.5, 3.3], (300, 3))])
    kinds = np.repeat([0, 1, 2], [6000, 1500, 300])
    opacities = np.where(kinds == 2, 0.1, rng.uniform(0.5, 0.9, len(kinds)))
    splats = Splats(
        places,
        np.full((len(kinds), 3), 0.02),
        np.tile([1.0, 0, 0, 0], (len(kinds), 1)),
        opacities,
        np.zeros((len(kinds), 1, 3)),
    )
    order = splats.spatial_order()
    folder = tmp_path_factory.mktemp("wall")
    door = LivePart("door", (places[:, 0] > 1).astype(np.float32), 0.0, (1.0, 1.0, 1.0), ENTRY)
    parts = LiveParts.of([door], order)
    write_splats(folder / "splat.compressed.ply", splats.take(order), "compressed.ply")
    (folder / ROWS_FILE).write_bytes(order.astype("<u4").tobytes())
    (folder / "parts.bin").write_bytes(parts.tobytes())
    meta = {"count": len(kinds), "frame": {"scene_from_splat": np.eye(4).tolist()}, "parts": parts.entries}
    (folder / "live.json").write_text(json.dumps(meta))
    return folder, places[order], kinds[order], order


ENTRY = {"name": "door", "file": "part1.npy", "splats": 7, "light": {"env": "noon", "rotate": 90}}


@pytest.mark.parametrize("middle", [[200, 200], [200, 110], [60, 300]])
def test_a_stroke_takes_what_is_seen_under_it(wall, middle):
    """Nearly all of the ball's front or of the wall in the circle, nothing behind it, no fog far before it."""
    folder, places, kinds, _ = wall
    found = np.isin(np.arange(len(kinds)), painted(folder, paint=[[*middle, 40]])["rows"])
    from_middle, from_ball = (np.linalg.norm(pixels(places) - at, axis=1) for at in (middle, (200, 200)))
    facing = np.einsum("nk,nk->n", places - BALL, EYE - places)
    seen = np.where(kinds == 1, facing > 0.15, (kinds == 0) & (from_ball > RIM + 25))
    fog = (kinds == 2) & (np.linalg.norm(places - BALL, axis=1) > 1.1)
    hidden = np.where(kinds == 1, (facing < 0) & (from_ball < 0.8 * RIM), fog | ((kinds == 0) & (from_ball < RIM)))
    assert found[seen & (from_middle < 39.5)].mean() > 0.95
    assert not found[hidden | (from_middle > 40.5)].any()


def test_erasing_gives_back_what_was_there(wall):
    folder = wall[0]
    before = np.frombuffer((folder / "parts.bin").read_bytes(), np.uint8)
    strokes = [[40, 200, 30, 360, 200]]
    whole = painted(folder, paint=strokes)
    assert whole["rows"] == painted(folder, paint=[[x, 200, 30, x + 80, 200] for x in range(40, 360, 80)])["rows"]
    assert len(whole["rows"]) > 500 and np.any(before[::2][whole["rows"]] == 1)
    half = painted(folder, paint=strokes, erase=[[360, 200, 60]])
    assert set(half["rows"]) < set(whole["rows"])
    none = painted(folder, paint=strokes, erase=strokes)
    assert none["rows"] == []
    np.testing.assert_array_equal(none["members"], before)


def test_the_files_are_a_part_of_the_scene(wall, tmp_path):
    """The mask is in the order of the splat file, and what the folder kept stays."""
    folder, _, _, order = wall
    np.save(tmp_path / "part1.npy", np.ones(3, bool))
    light = {"exposure": 1.5, "tint": [2.0, 0.75, 0.5]}
    rows = painted(folder, paint=[[200, 200, 50]], light=light, out=str(tmp_path))["rows"]
    found = np.load(tmp_path / "part2.npy")
    assert found.dtype == bool and np.array_equal(np.flatnonzero(found), np.sort(order[rows]))
    kept = kept_parts(tmp_path)
    assert list(kept) == ["door", "part2"] and kept["door"].entry == ENTRY and next_name(tmp_path) == "part3"
    assert kept["part2"].entry == {"name": "part2", "file": "part2.npy", "splats": len(rows), "light": light}
    shares = PartSpec.parse(kept["part2"].file).find(SplatFile(live_scene()[2].take(np.arange(len(order)) % 2500)))
    assert shares.sum() == len(rows)
    (asked,) = with_kept_lights(["part2"], tmp_path)
    part = LitPart.parse(asked)
    assert part.exposure_ev == 1.5 and part.tint[0] == pytest.approx(4 * part.tint[2])


def test_nothing_painted_is_nothing_to_save(wall, tmp_path):
    painted(wall[0], paint=[], out=str(tmp_path))
    assert not list(tmp_path.iterdir())
