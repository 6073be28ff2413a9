"""The cameras of a capture beside the file that is read, less the offset of its splats."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..base.errors import InputError
from ..render.view import View
from ..splats.facts import HERE
from ..splats.formats import parts_of
from ..splats.joining import at_offset
from ..splats.placing import similarity
from ..splats.splats import Splats
from .cameras import trained_views


def located_views(
    given: str | os.PathLike[str] | None, path: str | os.PathLike[str], lod: int | str, splats: Splats
) -> list[View]:
    """The cameras of a capture as `trained_views` finds them, in the frame of the splats.

    path, lod: as for `read_splats`; of a folder of which one file is read, cameras lie beside that. splats: cleaned.
    Cameras of a splat with an offset have it too, or have it taken off already: those that see the splat count.
    Raises InputError as `trained_views` does.
    """
    tiles = parts_of(path, lod).tiles
    beside = tiles[0] if len(tiles) == 1 else Path(path)
    offset = splats.facts.offset
    if offset == HERE:
        return trained_views(given, beside, splats)
    try:
        found = trained_views(given, beside, replace(splats, means=at_offset(splats, HERE)))
    except InputError:
        return trained_views(given, beside, splats)
    away = similarity(translation=np.asarray(offset))
    return [replace(view, camera_from_world=view.camera_from_world @ away) for view in found]
