"""Procedural scenes with known mesh, albedo, light and cameras, and Gaussian splats as if trained on them.

    truth = build("tabletop", seed=1)
    radiance = bake(truth, Environment.load("noon"))
    splats = splats_from(truth, radiance * exposure(radiance), 100_000)

`python -m scenes OUT` writes all of it to a folder.
"""

from .cameras import capture_views, seen_faces
from .kinds import KINDS, SceneTruth, build
from .light import bake, exposure
from .splat import splats_from

__all__ = ["KINDS", "SceneTruth", "bake", "build", "capture_views", "exposure", "seen_faces", "splats_from"]
