"""Generated scenes under many lights, which a network learns from: what places see, and show in each light."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from . import captures

LEARNED = {"blocks": 44, "garden": 12, "nook": 12, "object": 12, "tabletop": 11, "room": 4}
"""Kinds of the scenes that a network learns from, and how many of each; their seeds begin where those of PARTS end."""

LEARNED_SEED, LEARNED_LIGHTS = 21, 10
"""First of their seeds, and lights of each."""


class LitScene(NamedTuple):
    """A scene captured under several lights: N places, L lights.

    visible: (N, K / 8) bits, whether each of the directions (K, 3) is open. normals, positions: (N, 3). captured,
    bounced: (L, N, 3). images: (L, 64, 128, 3) radiance in captured units. looked: (64, 128) part of the sky that was
    seen; empty where there is none.
    """

    visible: np.ndarray
    directions: np.ndarray
    normals: np.ndarray
    positions: np.ndarray
    captured: np.ndarray
    bounced: np.ndarray
    images: np.ndarray
    looked: np.ndarray

    @classmethod
    def load(cls, path):
        """Read one."""
        with np.load(path) as file:
            return cls(**{name: file[name] for name in cls._fields})

    def places(self, rows, captured, bounced):
        """LitPlaces of some of the places, in colours (N, 3)."""
        from relight.albedo import samples
        from relight.albedo.evidence import LitPlaces

        count = len(self.directions)
        bits = np.unpackbits(self.visible[rows], axis=1)[:, :count]
        sky = (
            np.maximum(self.normals[rows] @ self.directions.T.astype(np.float32), 0.0) * np.float32(4.0 / count) * bits
        )
        pairs = samples.neighbor_pairs(self.positions[rows].astype(np.float64))
        colors = (each[rows].astype(np.float64) for each in (captured, bounced))
        return LitPlaces(sky, self.directions, *colors, self.normals[rows], *pairs)

    def seen_sky(self, image, rng, curved=False):
        """The SeenSky under a light map, or None."""
        from relight.albedo.skylight import seen_sky

        return (
            seen_sky(captures.photographed(image, self.looked[..., None], rng, curved), self.directions)
            if self.looked.size
            else None
        )


def make(folder, lights, say=print):
    """Paths of LitScenes under the lights of the fit part, made where they are missing."""
    own, paths = {name: image for name, image in lights.items() if captures.part_of(name) == "fit"}, []
    for kind, count in LEARNED.items():
        for seed in range(LEARNED_SEED, LEARNED_SEED + count):
            paths.append(Path(folder) / f"lit-{kind}{seed}.npz")
            if not paths[-1].exists():
                np.savez_compressed(paths[-1], **_lit(kind, seed, own)._asdict())
                say(f"lit: {kind} {seed}")
    return paths


def _lit(kind, seed, lights):
    """The LitScene of a kind and seed."""
    from relight.albedo.captured import CapturedScene, CaptureEvidence
    from relight.albedo.seen import looks_from
    from relight.engine.appearance import CAPTURE, sky_of
    from relight.engine.relighter import Relighter
    from splat2mesh.scene.color import linear_from_srgb
    from splat2mesh.splats.splats import SH_C0

    rng = np.random.default_rng([seed, LEARNED_LIGHTS, *kind.encode()])
    truth, scene = captures.meshed(kind, seed)
    shot = list(captures.shot_under(truth, lights, LEARNED_LIGHTS, rng))
    relighter = Relighter(scene)
    known = relighter.transport(CAPTURE, alone=True)
    index, weight, _ = captures.splats_around(scene, truth, shot[0][2])
    shown = [np.clip(splats.sh[:, 0] * SH_C0 + 0.5, 0.0, 1.0)[index] for _, _, splats, _ in shot]
    captured = [linear_from_srgb((weight * each).sum(axis=1).astype(np.float32)) for each in shown]
    sky = sky_of(scene)
    evidence = CaptureEvidence(sky, looks_from(scene, relighter.occluder))
    day = CapturedScene(relighter.occluder, np.mean(captured, axis=0), 0, lambda count: None, known, evidence)
    rows, looked = day.places.vertices, np.zeros((0, 0)) if day.sky is None else (sky.bound + sky.clipped).mean(axis=2)
    normals, positions = (each[rows] for each in (relighter.occluder.normals, relighter.occluder.origins))
    bounced = np.stack([known.interreflection.bounce(each)[rows] for each in captured])
    colors, images = np.stack([each[rows] for each in captured]), np.stack([image for _, image, _, _ in shot])
    bits = np.packbits(day.places.sky > 0.0, axis=1)
    return LitScene(bits, day.places.directions, normals, positions, colors, bounced, images.astype(np.float32), looked)
