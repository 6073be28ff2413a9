"""Small bundles of live light made of random numbers, as docs/live.md has them, and what their loaders should find."""

import hashlib
import json
import runpy
from pathlib import Path

import numpy as np
from splat_samples import make_splats

from relight.live.response import evaluate
from relight.splats.light_ratio import CURVE_POWER
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.formats import write_splats

READER = Path(__file__).parents[2] / "examples" / "read_bundle.py"

DIRECT, SPREAD, DIRECTIONS = 100, 16, 7


def reader():
    """The names of the reader that docs/live.md refers to: read, turned, change."""
    return runpy.run_path(str(READER))


def make_bundle(folder, count=60, clusters=5, weights=6, seed=0, splats=None, lamps=False):
    """A bundle in a folder that exists. Most splats are lit, some stay as captured, some are sky. lamps: whether it has
    captured light and two lamps as terms, and as its second light that of the capture."""
    rng = np.random.default_rng(seed)
    splats = make_splats(count, 1, seed) if splats is None else splats
    entries = []
    for kind in ("compressed.ply", "ply"):
        file = folder / f"splat.{kind}"
        write_splats(file, splats, kind)
        entries.append({"file": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest(), "count": count})
    rows = np.zeros((count, 2 + weights), np.uint8)
    rows[:, :2] = rng.integers(0, clusters, count).astype("<u2")[:, None].view(np.uint8)
    rows[:, 2:] = rng.integers(-127, 128, (count, weights)).astype(np.int8).view(np.uint8)
    (folder / "transfer.bin").write_bytes(rows.tobytes())
    surface = rng.integers(0, 256, (count, 8)).astype(np.uint8)
    surface[:, 7] = np.arange(count) % 10 == 3
    surface[:, 7] = np.where(np.arange(count) % 10 == 7, 2, 1 - surface[:, 7])
    kinds = surface[:, 7].copy()
    surface[:, 7] |= rng.integers(0, 64, count).astype(np.uint8) << 2
    (folder / "surface.bin").write_bytes(surface.tobytes())
    numbers = DIRECT + SPREAD + 1
    fall = (1.0 + np.sqrt(np.r_[np.arange(DIRECT), np.arange(SPREAD), 0]).astype(int)) ** -1.5
    directions = np.rint(32767 * rng.uniform(-0.3, 1.0, (1 + DIRECTIONS, numbers, 3)) * fall[:, None])
    means = np.rint(32767 * rng.uniform(-1.0, 1.0, (clusters, DIRECTIONS)))
    components = np.rint(127 * rng.uniform(-1, 1, (clusters, weights, DIRECTIONS)))
    scales = np.concatenate([np.full((clusters, 1), 1e-5), np.full((clusters, weights), 2e-6)], axis=1)
    arrays = (np.full(1 + DIRECTIONS, 1e-5), "<f4"), (directions, "<i2"), (scales, "<f4"), (means, "<i2")
    parts = [array.astype(kind).tobytes() for array, kind in (*arrays, (components, "i1"))]
    (folder / "basis.bin").write_bytes(b"".join(parts))
    (folder / "lights").mkdir(exist_ok=True)
    lights = []
    for number in range(2):
        image = rng.integers(0, 256, (64, 128, 4)).astype(np.uint8)
        image[..., 3] = 128
        (folder / "lights" / f"{number}.rgbe").write_bytes(image.tobytes())
        toward = rng.normal(size=3)
        suns = [{"direction": (toward / np.linalg.norm(toward)).tolist(), "weight": [2.0, 1.5, 1.0]}] * number
        rest, whole = rng.normal(size=(DIRECT, 3)), rng.normal(size=(SPREAD, 3))
        rest[0], whole[0] = 4.0, 5.0
        lights.append(
            {
                "name": f"light {number}",
                "file": f"lights/{number}.rgbe",
                "exposure": 0.6,
                "mean": 1.0,
                "lamps": 0.2 * number,
            }
            | {"rest": rest.tolist(), "whole": whole.tolist(), "suns": suns}
        )
    frame = [[0.0, 1, 0, 0.5], [0, 0, -1, 0.25], [-1, 0, 0, -2], [0, 0, 0, 1]]
    meta = {
        "format": "relight-live",
        "version": 1,
        "count": count,
        "order": "row i = splat i",
        "splats": entries,
        "frame": {"scene_from_splat": frame, "up": "+y", "middle": [0.1, 0.2, 0.3]},
        "transfer": {"weights": weights},
        "basis": {"clusters": clusters, "weights": weights, "directions": DIRECTIONS}
        | {"direct": DIRECT, "spread": SPREAD, "lamps": 1},
        "surface": {"lift": 0.01, "own": [1.0, 1.0, 1.0], "own_steps": 32.0},
        "mean": rng.uniform(0, 0.2, (SPREAD + 1, 3)).tolist(),
        "brightness": None,
        "lamps": 0.2,
        "lights": lights,
    }
    if lamps:
        meta |= {"version": 2, "terms": _terms(folder, count, kinds)}
        for light, sky in zip(lights, ("own", "captured"), strict=True):
            light |= {"captured": 0.3, "unit": 0.5, "sky": sky}
        nothing = np.zeros((DIRECT, 3)).tolist()
        lights[1] |= {"rest": nothing, "whole": nothing[:SPREAD], "suns": [], "lamps": 0.0}
    (folder / "live.json").write_text(json.dumps(meta), encoding="utf-8")
    return meta, splats, kinds


def _terms(folder, count, kinds):
    """The terms of a bundle, whose file is written: no splat but a lit one is in their runs."""
    rng, content = np.random.default_rng(4), b""
    even = {"kind": "captured", "name": "Captured light", "color": [1.0, 1.0, 1.0], "runs": None, "rows": None}
    terms = [even | {"peak": [1.0, 1.0, 1.0], "steps": 1.0, "mean": [1.0, 1.0, 1.0]}]
    for number, shining in enumerate((np.arange(count) < count // 2, np.arange(count) % 7 > 1)):
        edges = np.diff(np.r_[0, (shining & (kinds == 1)).astype(int), 0])
        first, end = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        runs, rows = np.stack([first, end - first], axis=1), rng.integers(0, 256, ((end - first).sum(), 3))
        content += runs.astype("<u4").tobytes() + rows.astype(np.uint8).tobytes()
        term = {"kind": "lamp", "name": f"Lamp {number + 1}", "color": [2.0 - number, 0.8, 0.1 + number]}
        term |= {"runs": len(runs), "rows": len(rows), "peak": [3.0, 2.0, 1.5], "steps": 20.0, "mean": [0.2, 0.1, 0.1]}
        terms.append(term)
    (folder / "terms.bin").write_bytes(content)
    return terms


def soft_suns(light):
    """A light of live.json with its suns in the harmonics, as loaders without shadow maps have it."""
    rest = np.array(light["rest"])
    for sun in light["suns"]:
        rest += evaluate(np.array([sun["direction"]]), 10)[0][:, None] * np.array(sun["weight"])
    return light | {"rest": rest.tolist()}


def gain(color, change):
    """The factor on (colour + .055) of display values under a change of light, by the formulas of docs/live.md."""
    linear = linear_from_srgb(np.maximum(color, 0.0))
    shown, start = change * linear, np.maximum(0.8, linear)
    room = np.maximum(1.0 - start, 1e-3)
    rolled = start + room * (1.0 - np.exp(-np.maximum(shown - start, 0.0) / room))
    ratio = np.where(linear > 1e-4, np.where(shown > start, rolled, shown) / np.maximum(linear, 1e-4), change)
    return np.clip(ratio, 1e-4, 1e4) ** (1.0 / CURVE_POWER)
