"""What is measured on a source and the scene made of it: the captured sky, what is a volume, and how thick it is."""

import numpy as np

from ..render.thickness import optical_depth
from ..scene.measured import Measured
from ..splats.splats import usable
from .captured_sky import captured_sky
from .volume import splat_volume, vertex_volume

LEAST_LEAFY, LEAST_SHARE = 0.25, 0.005
"""Volume of a vertex, and part of the vertices that have more, from which it is measured how thick leaves and grass
are."""


def measured_of(
    splats,  # Splats as read, every row of the source
    background,  # (M,) rows that are far background
    vertices,  # (V, 3) of the scene, scene frame
    scene_from_splat,  # (4, 4)
    eyes=(),  # (3,) each, where the capture stood, scene frame; the middle of the rest without
):
    """The Measured; rows of no use, by `usable`, are no volume."""
    far = np.zeros(len(splats), bool)
    far[background] = True
    rows = np.flatnonzero(usable(splats)[0])
    drawn, background = splats.take(rows), far[rows]
    near = np.flatnonzero(~background)
    subject = drawn.take(near)
    volume = np.zeros(len(splats), np.float32)
    measured = splat_volume(subject)
    volume[rows[near]] = measured
    back = np.linalg.inv(np.asarray(scene_from_splat, np.float64))
    eye = None if not len(eyes) else np.mean(np.asarray(eyes, np.float64), axis=0) @ back[:3, :3].T + back[:3, 3]
    sky = captured_sky(drawn, background, scene_from_splat, eye)
    points = vertices @ back[:3, :3].T + back[:3, 3]
    found = Measured(sky, volume, vertex_volume(points, subject, measured))
    if not (found.foliage > LEAST_LEAFY).mean() > LEAST_SHARE:
        return found
    return found._replace(depth=optical_depth(subject, measured, scene_from_splat))
