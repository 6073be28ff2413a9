"""The pose of a scene whose chunks move."""

from collections.abc import Mapping

import numpy as np

from splat2mesh.base.arrays import Directions, Points
from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene


def moved(scene: Scene, changes: Mapping[int, tuple[Points, Directions]]) -> Scene:
    """A Scene with other vertices and normals of some chunks, chunk -> (V, 3) each, scene frame, as many as it had.

    Raises InputError for chunks that the scene does not have, and for arrays that do not fit or are not finite.
    """
    chunks = list(scene.chunks)
    for number, pose in changes.items():
        if number != int(number) or not 0 <= number < len(chunks):
            raise InputError(f"chunk {number}: the scene has chunks 0 to {len(chunks) - 1}")
        old = chunks[number]
        vertices, normals = (np.asarray(values, np.float32) for values in pose)
        for values in (vertices, normals):
            if values.shape != old.vertices.shape or not np.isfinite(values).all():
                message = f"vertices and normals must have shape {old.vertices.shape} and be finite"
                raise InputError(f"chunk {number}: {message}")
        chunks[number] = Mesh(vertices, normals, old.faces, old.colors_srgb)
    return Scene(chunks)
