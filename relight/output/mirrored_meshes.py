"""Written meshes of places whose floor mirrors: what they have of the mirror world is lit as the splats there."""

from typing import TYPE_CHECKING

import numpy as np

from ..engine.appearance import LEAST_ALBEDO
from .relit_splats import RelitSource
from .subject import WrittenScene

if TYPE_CHECKING:
    from ..engine.relighter import Shaded
    from ..splats.mirrored_mesh import MirroredMesh


class MirroredMeshes:
    """The light of one scene's mesh, light after light, with the reflections of its floor."""

    def __init__(self, written: WrittenScene, relit: RelitSource) -> None:
        self._scene, self._look = written.relighter.scene, written.appearance
        self._mirror, self._binding, self._relit = written.mirror, written.binding, relit
        self._mesh: MirroredMesh | None = None

    def with_reflections(self, shaded: "Shaded") -> "Shaded":
        """The same, with what the mesh has of a mirror world below a floor lit as the splats there."""
        look, shading = self._look, shaded.shading
        if not self._scene.is_place or look.capture is None or (look.kept and shading.received is None):
            return shaded
        mirror = self._mirror()
        if mirror is None:
            return shaded
        if self._mesh is None:
            from ..splats.mirrored_mesh import MirroredMesh

            self._mesh = MirroredMesh(self._scene, mirror, self._binding())
        received = np.array(self._relit.received(shading))
        radiance = self._mesh.lit(shading.radiance, look.irradiance, received, shaded.exposure)
        rows = self._mesh.rows
        albedo = look.captured if look.albedo is None else look.albedo
        received[rows] = radiance[rows] / np.maximum(albedo[rows], np.float32(LEAST_ALBEDO))  # what textures show
        return shaded._replace(shading=shading._replace(radiance=radiance, received=received))
