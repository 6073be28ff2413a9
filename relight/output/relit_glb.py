"""relit.glb of one light after another, in the texture of the scene where it has one."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from splat2mesh.base.beside import Beside

from . import mesh_files
from .relit_splats import RelitSource
from .relit_texture import RelitTexture
from .subject import WrittenScene

if TYPE_CHECKING:
    from ..engine.relighter import Shaded


class RelitGlb:
    """Writes the mesh of a WrittenScene in its lights; what does not depend on them is made once."""

    def __init__(self, written: WrittenScene, source: RelitSource) -> None:
        self._written, self._source, self._scene = written, source, written.relighter.scene
        self._texture: Any = None  # False where the scene has none

    def begin(self, path: Path, shaded: "Shaded") -> Beside[int]:
        """Begin to write the file, beside other work: the number of vertices that are clipped."""
        light, written = shaded.light, self._written
        placed = written.lamps(light, shaded.exposure)
        extras = {"environment": light.name, "angle_deg": light.rotation_deg}
        if self._texture is None:
            made = written.texture or (lambda: RelitTexture.of_scene(self._scene, written.appearance))
            self._texture = made() or False

        def write() -> int:
            radiance, exposure = shaded.shading.radiance, shaded.exposure
            with written.relighter.stages.stage("write"):
                if not self._texture:
                    return mesh_files.write_glb(path, self._scene, radiance, exposure, extras, placed)
                exposed = mesh_files.check_radiance(self._scene, radiance) * exposure
                clipped = int((exposed > 1.0).any(axis=1).sum())
                received = self._source.received(shaded.shading, exposure)
                own = {"clipped_vertices": clipped, **extras}
                self._texture.write(path, received, exposure, own, placed, radiance)
                return clipped

        return Beside(write)
