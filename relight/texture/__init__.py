"""Textures for meshes with few faces: the detail of the splat, without the light of its capture, under any light.

baked = bake(scene, splats, irradiance, prior)
colors = baked.relit(new_irradiance, exposure)
"""

from .atlas import Atlas, unwrap
from .baking import Baked, bake

__all__ = ["Atlas", "Baked", "bake", "unwrap"]
