"""A mesh whose splats show what a floor mirrors: its vertices below the floor, lit as those splats are."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from splat2mesh.base.arrays import Indices, Radiance
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats

from .binding import Binding
from .floor_mirror import FloorMirror, placed
from .light_ratio import CURVE_POWER
from .mirrored_places import MirroredPlaces


class MirroredMesh:
    """The vertices of a Scene that show the reflections of its floor. rows: (M,) of the vertices."""

    def __init__(self, scene: Scene, mirror: FloorMirror, binding: Binding) -> None:
        """binding: of the splats of the scene, with the floor."""
        self._scene, self._binding = scene, binding
        self.rows = mirrored_vertices(scene, mirror, binding)
        back = np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
        count, ones = len(self.rows), np.ones((len(self.rows), 3), np.float32)  # round: without a normal of their own
        means = (scene.vertices[self.rows] @ back[:3, :3].T + back[:3, 3]).astype(np.float32)
        upright = np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (count, 1))
        sh = (scene.colors_srgb[self.rows].astype(np.float32) / 255.0 - 0.5)[:, None] / np.float32(SH_C0)
        points = Splats(means, ones, upright, ones[:, 0], sh)
        self._places = MirroredPlaces(mirror, binding.surface, scene, points, np.arange(count)) if count else None

    def lit(self, radiance: Radiance, before: Radiance, after: Radiance, exposure: float) -> NDArray[np.float32]:
        """Radiance (V, 3) of the vertices, with that of the reflections in place of what they would send as things.
        before, after, exposure: of `Binding.relit`."""
        if self._places is None:
            return np.asarray(radiance, np.float32)
        of_nodes = self._binding.log_gains(before, after, exposure)
        own_nodes = self._binding.surface.node[self.rows]
        logs = self._places.log_gains(of_nodes, of_nodes[own_nodes])
        result = np.array(radiance, np.float32)
        result[self.rows] = self._scene.colors_linear[self.rows] * np.exp(CURVE_POWER * logs) / exposure
        return result


def mirrored_vertices(scene: Scene, mirror: FloorMirror, binding: Binding) -> Indices:
    """Rows (M,) of the vertices below a floor whose nearest splat there is a reflection."""
    points, reflected = placed(binding.shown, scene), binding.mirrored
    below = np.flatnonzero(points @ mirror.normal < mirror.offset - mirror.margin)
    rows = np.flatnonzero(scene.vertices @ mirror.normal < mirror.offset - mirror.margin)
    if reflected is None or not len(rows) or not len(below):
        return rows[:0]
    nearest = below[cKDTree(points[below]).query(scene.vertices[rows])[1]]
    return np.asarray(rows[np.isin(nearest, reflected.rows)])
