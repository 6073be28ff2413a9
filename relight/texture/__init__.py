"""Textures: the detail of the splat on a mesh, without the light of its capture, under any light.

baked = bake(scene, splats, KnownColors(irradiance, prior))
colors = baked.relit(new_irradiance, exposure)
"""

from splat2mesh.texture.atlas import Atlas

from .baking import Baked, KnownColors, bake
from .own import known_colors, own_texture

__all__ = ["Atlas", "Baked", "KnownColors", "bake", "known_colors", "own_texture"]
