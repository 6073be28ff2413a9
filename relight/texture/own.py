"""The texture that a scene folder holds, without the light of the capture."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from splat2mesh.texture.kept import kept_file, kept_texture, textured_part

from .baking import Baked, KnownColors

if TYPE_CHECKING:
    from splat2mesh.scene.drawn import Drawn
    from splat2mesh.scene.scene import Scene

    from ..engine.appearance import Appearance


def own_texture(scene: "Scene", look: "Appearance") -> Callable[[], Baked | None]:
    """The function that returns the Baked texture of mesh.glb, for the `textured_part` of a Scene, or None without.

    The file is read at once. Warns where it is not as `splat2mesh` wrote it.
    """
    content = kept_file(scene)
    if content is None:
        return lambda: None
    part, unseen = textured_part(scene), int(scene.statistics.get("texels_unseen", 0))
    return lambda: Baked.of(*kept_texture(part, content), known_colors(part, look), unseen)


def known_colors(part: "Drawn", look: "Appearance") -> KnownColors:
    """What an Appearance says of the captured light at the vertices of a drawn part of its scene."""
    if look.prior is not None:
        return KnownColors(None if look.irradiance is None else part.values(look.irradiance), look.prior)
    # Nothing was estimated: the texels take the albedo of the vertices, unless that is what was captured.
    if look.albedo is look.captured:
        return KnownColors()
    return KnownColors(albedo=part.values(np.ones_like(look.captured) if look.albedo is None else look.albedo))
