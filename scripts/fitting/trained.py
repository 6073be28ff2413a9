"""Captures of trained splats whose light is known, as arrays like those of `captures`: for the usual colours."""

import json
from pathlib import Path

import numpy as np

from .captures import DIRECTIONS, harmonics_of


def make(folder, truths, say=print):
    """Make what is missing of the captures of trained splats.

    Each of truths is a folder with `point_cloud.ply`, `env_train.exr`, and `meta.json`: its `up` axis, and the
    `exposure` that takes the unit of the light to that of the splat's linear colours.
    """
    for truth in truths:
        path = Path(folder) / f"trained-{truth.name}.npz"
        if not path.exists():
            np.savez(path, **_arrays(truth))
            say(f"trained: {truth.name}")


def load(folder):
    """All of them, dicts of arrays."""
    found = []
    for path in sorted(Path(folder).glob("trained-*.npz")):
        with np.load(path) as file:
            found.append({name: file[name] for name in file.files} | {"scene": path.stem})
    return found


def _arrays(truth):
    from relight import Environment
    from relight.albedo.captured import CapturedScene, CaptureEvidence
    from relight.albedo.seen import looks_from
    from relight.albedo.skylight import seen_sky
    from relight.engine.appearance import CAPTURE, sky_of
    from relight.engine.relighter import Relighter
    from splat2mesh import convert

    meta = json.loads((truth / "meta.json").read_text(encoding="utf-8"))
    scene = convert(truth / "point_cloud.ply", detail="draft", texture="none", up=meta["up"])
    relighter = Relighter(scene)
    known = relighter.transport(CAPTURE, alone=True)
    evidence = CaptureEvidence(sky_of(scene), looks_from(scene, relighter.occluder))
    day = CapturedScene(relighter.occluder, scene.colors_linear, 0, lambda count: None, known, evidence)
    turn = np.asarray(scene.scene_from_splat)[:3, :3]
    turn = turn / np.cbrt(np.linalg.det(turn))
    light = Environment.load(truth / "env_train.exr").lookup(DIRECTIONS @ turn).reshape(64, 128, 3)
    places = day.evidence.places
    found = {**places._asdict(), "light": harmonics_of(light * meta["exposure"])}
    if day.sky is not None:
        cells = seen_sky(day.sky, places.directions)
        found |= {"sky_log": cells.log_radiance, "sky_seen": cells.seen, "sky_clipped": cells.clipped}
    return found
