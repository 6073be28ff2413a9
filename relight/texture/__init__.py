"""Textures for meshes with few faces: the splat's own detail, without the light of its capture, under any light.

baked = bake(scene, splats, irradiance, prior)
write_textured_glb("relit_texture.glb", scene, baked, baked.relit(new_irradiance, exposure))
"""

from .atlas import Atlas, unwrap
from .baking import Baked, bake
from .write import write_textured_glb, write_transfer

__all__ = ["Atlas", "Baked", "bake", "unwrap", "write_textured_glb", "write_transfer"]
