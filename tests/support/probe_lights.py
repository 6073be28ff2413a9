"""Lights whose irradiance is known in closed form, and a file of probes in them."""

import json

import numpy as np

from splat2mesh.base.sphere import texel_directions

AXIS = np.array([0.48, 0.6, 0.64])
"""A unit vector without symmetry, so that no mirrored or swapped axis goes unseen."""

TINT = np.array([1.0, 0.5, 0.25])


def lobe(directions):
    """Radiance of a single cosine lobe about AXIS, (N, 3)."""
    return np.maximum(directions @ AXIS, 0.0)[..., None] * TINT


def lobe_irradiance(normals):
    """Irradiance over pi in it, (N, 3): 2 / (3 pi) (sin t + (pi - t) cos t), t the angle to AXIS (Cho and Saul 2009's
    kernel of two clamped cosines, on the sphere)."""
    angle = np.arccos(np.clip(normals @ AXIS, -1.0, 1.0))
    found = 2.0 / (3.0 * np.pi) * (np.sin(angle) + (np.pi - angle) * np.cos(angle))
    return found[..., None] * TINT


LOBE_ERROR = 0.006
"""What nine harmonics leave out of `lobe_irradiance`: degree four and on. It is .0053 at most over the sphere."""


def picture(radiance, height=64):
    """The lat-long picture of a radiance of directions, (height, 2 height, 3) float32."""
    return radiance(texel_directions(height, 2 * height)).astype(np.float32)


def write_probes_in(path, lights, positions):
    """A probes.json of pictures of light at positions of the scene frame."""
    from relight.output.probe_files import FORMAT, irradiance_of

    pairs = zip(positions, lights, strict=True)
    probes = [{"position": list(map(float, at)), "sh": irradiance_of(light).tolist()} for at, light in pairs]
    path.write_text(json.dumps({"format": FORMAT, "version": 1, "probes": probes}))
