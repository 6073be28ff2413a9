"""Splats as objects: they lose the light that they were captured in, and take that of the place they are put in."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.scene import Scene
from splat2mesh.splats.placing import placed
from splat2mesh.splats.splats import Splats

from ..splats import Binding
from .objects import DARKEST, InsertedObject, Part

if TYPE_CHECKING:
    from ..engine.appearance import Appearance


@dataclass(frozen=True, eq=False)
class SplatObject:
    """N Gaussians that are put in, and the mesh that they are lit by.

    binding: of the splats to their own scene. irradiance: (V, 3) that their mesh received on their capture day. rows:
    (M,) of the splats that are put in; far background is not. object_from_splat: (4, 4).
    """

    binding: Binding
    irradiance: NDArray[np.float32]
    rows: NDArray[np.int64]
    object_from_splat: NDArray[np.float64]

    def relit(
        self,
        light: NDArray[np.float32],  # (V, 3) irradiance over pi, in units of the picture
        splat_from_object: NDArray[np.float64],  # (4, 4), the splat of the place
    ) -> Splats:
        """Return them in the light of the place, in the frame of its splat."""
        splats = self.binding.relit(self.irradiance, light).take(self.rows)
        return placed(splats, splat_from_object @ self.object_from_splat)


def splat_object(name: str, scene: Scene, binding: Binding, count: int, look: "Appearance") -> InsertedObject:
    """Return an object of `count` splats and their own Scene: its frame is upright, and begins where theirs does."""
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
