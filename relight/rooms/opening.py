"""A room without its ceiling, so that an environment enters from above."""

from dataclasses import replace

import numpy as np

from splat2mesh.base.errors import InputError
from splat2mesh.scene.scene import Scene

from ..albedo.interior import within
from ..sh.sphere import fibonacci_sphere
from ..transfer.occluder import Frame, Occluder

LOOKS = 256
"""Directions from each eye; those within UPRIGHT of straight up find the ceiling."""

UPRIGHT = 0.8

MARGIN = 0.2
"""Share of the way from the eyes to the ceiling: what hangs further below it is not part of it. Ceilings of trained
rooms are uneven by a tenth of their height."""


def without_ceiling(scene: Scene, occluder: Occluder) -> Scene:
    """Take the ceiling off a room, so that an environment enters from above.

    Parameters
    ----------
    scene : Scene
        Captured from within.
    occluder : Occluder
        The same scene to trace rays in.

    Returns
    -------
    Scene
        All the vertices, without the faces of the ceiling: for light alone.

    Raises
    ------
    InputError
        If the capture was not inside a closed space, if nothing is above it, or if nothing would remain.

    Notes
    -----
    Rays go up from where the capture stood; the ceiling lies where half of them end.
    """
    eyes, frame = within(scene), Frame.around(scene.vertices, scene.faces)
    if not len(eyes):
        raise InputError("`opened` ceiling: expected a room that was captured from inside, found none")
    directions = fibonacci_sphere(LOOKS)
    up = directions[directions[:, 1] > UPRIGHT]
    origins = np.repeat(frame.unit(eyes), len(up), axis=0)
    rays = np.hstack([origins, np.tile(up, (len(eyes), 1))]).astype(np.float32)
    hits = occluder.first_hits(rays)
    hit = hits.faces >= 0
    if not hit.any():
        raise InputError("`opened` ceiling: nothing is above where the capture stood")
    heights = origins[hit, 1] + hits.distance[hit] * rays[hit, 4]
    level, eye = float(np.median(heights)), float(np.median(origins[:, 1]))
    lowest = (level - MARGIN * (level - eye)) * frame.diagonal + frame.center[1]
    chunks = []
    for chunk in scene.chunks:
        above = (chunk.vertices[chunk.faces, 1] > lowest).all(axis=1)
        chunks.append(replace(chunk, faces=np.ascontiguousarray(chunk.faces[~above])))
    if not sum(len(chunk.faces) for chunk in chunks):
        raise InputError("`opened` ceiling: nothing is left of the scene without it")
    return replace(scene, chunks=chunks, path=None)
