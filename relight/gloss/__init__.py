"""Gloss: the reflected part of a captured colour, its roughness and strength, and the reflection of a new light.

found = observed(binding, looks, ...)              which patches reflect, from pictures of the splat
gloss = materials(found, captured_light)           reflectance and roughness of every node
Reflections(binding, ...).relit(splats, ...)       harmonics of degree 3 with the new reflections
SceneGloss(scene, splats, ...)                     all of it for one scene, kept and in any light
"""

from .fits import PatchFits, observed
from .material import Gloss, materials
from .reflections import Reflections
from .scene_gloss import SceneGloss

__all__ = ["Gloss", "PatchFits", "Reflections", "SceneGloss", "materials", "observed"]
