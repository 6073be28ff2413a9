"""A room without its ceiling, which an environment enters from above."""

from dataclasses import replace

import numpy as np

from splat2mesh.base.errors import InputError
from splat2mesh.scene.scene import Scene

from ..transfer.occluder import Frame, Occluder
from .interior import within
from .seen import UNEVEN, ceiling_level

MARGIN = 2.0 * UNEVEN
"""Share of the way from the eyes to the ceiling: what hangs further below it is not part of it. Ceilings of trained
rooms are uneven by half of that."""


def without_ceiling(scene: Scene, occluder: Occluder) -> Scene:
    """The Scene of a room without the faces of its ceiling, for light alone: an environment enters from above.

    Raises InputError if the capture was not inside a closed space, if nothing is above it, or if nothing would remain.
    """
    eyes, frame = within(scene), Frame.around(scene.vertices, scene.faces)
    if not len(eyes):
        raise InputError("`opened` ceiling: expected a room that was captured from inside, found none")
    found = ceiling_level(occluder, frame.unit(eyes))
    if found is None:
        raise InputError("`opened` ceiling: nothing is above where the capture stood")
    level, eye = found
    lowest = (level - MARGIN * (level - eye)) * frame.diagonal + frame.center[1]
    chunks = []
    for chunk in scene.chunks:
        above = (chunk.vertices[chunk.faces, 1] > lowest).all(axis=1)
        chunks.append(replace(chunk, faces=np.ascontiguousarray(chunk.faces[~above])))
    if not sum(len(chunk.faces) for chunk in chunks):
        raise InputError("`opened` ceiling: nothing is left of the scene without it")
    return replace(scene, chunks=chunks, path=None)
