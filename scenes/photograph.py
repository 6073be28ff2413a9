"""The true picture of a place from a camera, by ray casting: the reference for renderings of splats."""

import numpy as np

from .cameras import FLIP


def photograph(lighting, view, samples=1):
    """The picture that `view` (splat's frame, y down) takes: linear radiance (H, W, 3) float32 and solid (H, W) bool.

    samples: a side of each pixel. The environment shows where nothing solid is; solid marks pixels without it.
    """
    fine = view.resized(max(view.width, view.height) * samples)
    toward = (fine.ray_directions() * FLIP).reshape(-1, 3)
    rays = np.hstack([np.broadcast_to(view.center * FLIP, toward.shape), toward])
    hits = lighting.caster.first_hits(rays)
    solid = hits.faces >= 0
    uv = hits.uv[solid]
    weights = np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1)
    picture = np.empty((len(rays), 3), np.float32)
    picture[solid] = lighting.at(hits.faces[solid], weights)
    picture[~solid] = lighting.environment.lookup(toward[~solid])

    def binned(values):
        shape = (view.height, samples, view.width, samples, -1)
        return values.reshape(shape).mean(axis=(1, 3))

    return binned(picture), binned(solid)[..., 0] == 1
