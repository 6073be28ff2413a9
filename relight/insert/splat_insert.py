"""A splat as an inserted object: its mesh carries the light, in an upright frame."""

from typing import TYPE_CHECKING

import numpy as np

from splat2mesh.scene.scene import Scene

from ..albedo.division import DARKEST
from ..splats import Binding
from .objects import InsertedObject, Part
from .splat_object import SplatObject

if TYPE_CHECKING:
    from ..engine.appearance import Appearance


def splat_object(name: str, scene: Scene, binding: Binding, count: int, look: "Appearance") -> InsertedObject:
    """Return an object of `count` splats and their own Scene. Its frame is upright and has their origin."""
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    scale = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3])))) or 1.0
    vertices = ((scene.vertices.astype(np.float64) - matrix[:3, 3]) / scale).astype(np.float32)
    albedo = np.ones_like(look.captured) if look.albedo is None else look.albedo
    albedo = np.maximum(albedo, np.float32(DARKEST))
    color = np.concatenate([albedo, np.ones((len(albedo), 1), np.float32)], axis=1)
    part = Part(vertices, scene.normals, scene.faces, color, None, albedo, np.zeros_like(albedo))
    object_from_splat = np.eye(4)
    object_from_splat[:3, :3] = matrix[:3, :3] / scale
    rows = np.delete(np.arange(count), scene.background_splats)
    return InsertedObject(name, [part], splat=SplatObject(binding, look.irradiance, rows, object_from_splat))
