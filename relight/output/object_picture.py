"""Pictures of objects on a mesh that was not made from a splat."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

from .picture import RelitPicture

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight
    from ..light.environment import Environment


def mesh_with_objects(
    scene: Scene,
    radiance: NDArray[np.float32],  # (V, 3) of the scene without the objects
    inserted: "InsertedLight",
    camera: dict[str, Any],
    size: tuple[int, int],
    light: "Environment | None",
    exposure: float,
) -> NDArray[np.uint8]:
    """A picture (H, W, 3) uint8 sRGB of a scene with objects, and what these change of its light."""
    standing = inserted.standing
    colors = np.zeros(standing.vertices.shape, np.uint8)
    objects = Mesh(standing.vertices, standing.normals, standing.faces, colors)
    drawn = Drawn(scene)
    both = np.concatenate([drawn.colors(radiance * inserted.ratio), inserted.radiance])
    shown = Scene([*drawn.scene.chunks, objects], scene_from_splat=scene.scene_from_splat, capture=scene.capture)
    return np.asarray(RelitPicture(shown, camera, size).of_vertices(both, light, exposure, inset=False), np.uint8)
