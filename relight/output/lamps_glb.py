"""Placed lamps in glTF files, so the same lamps light what an engine adds to a relit scene."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import pygltflib as gltf

from splat2mesh.scene.glb import Glb

from ..lamps.gltf_lights import PUNCTUAL, khr_lights

if TYPE_CHECKING:
    from ..lamps.shapes import Lamp
    from ..light.environment import Environment


class PlacedLamps(NamedTuple):
    """lamps: in the frame of the scene; radiance 1 shows as white. names: of each, "" for none."""

    lamps: "Sequence[Lamp]" = ()
    names: Sequence[str] = ()


NO_LAMPS = PlacedLamps()


class ShownLight(NamedTuple):
    """A light, turned, with its exposure in display values per unit of radiance, and placed lamps beside it."""

    light: "Environment"
    exposure: float
    placed: PlacedLamps = NO_LAMPS


def add_lamps(file: Glb, placed: PlacedLamps) -> None:
    """Add lamps to a document whose nodes stand in the frame of the scene; nothing where there are none."""
    if not placed.lamps:
        return
    extension, nodes = khr_lights(placed.lamps, placed.names)
    document = file.document
    document.extensionsUsed.append(PUNCTUAL)
    document.extensions[PUNCTUAL] = extension
    document.nodes += [gltf.Node(**node) for node in nodes]
