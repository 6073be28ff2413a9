"""Textures for meshes with few faces: the detail of the splat, without the light of its capture, under any light.

baked = bake(scene, splats, KnownColors(irradiance, prior))
colors = baked.relit(new_irradiance, exposure)
"""

from splat2mesh.texture.atlas import Atlas

from .baking import Baked, KnownColors, bake
from .unwrap import unwrap

__all__ = ["Atlas", "Baked", "KnownColors", "bake", "unwrap"]
