"""What tells of the light around: probes of it, and what objects change of it."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from splat2mesh.base.arrays import Vector
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

from ..transfer.occluder import Occluder

if TYPE_CHECKING:
    from ..engine.relighter import Shaded
    from ..insert.probe import Light


class AroundFiles:
    """Writes these files of a scene, light after light.

    kinds: words of `kinds.AROUND`, and others. light: returns the Light of one of the lights. places: of probes, in the
    frame of the splats.
    """

    def __init__(
        self,
        scene: Scene,
        occluder: Occluder,
        kinds: Sequence[str],
        light: "Callable[[Shaded], Light]",
        places: "Sequence[Vector]" = (),
    ) -> None:
        self._scene, self._occluder, self._kinds = scene, occluder, kinds
        self._light, self._places = light, list(places)

    def write(self, folder: Path, relit: Splats, shaded: "Shaded") -> list[str]:
        """Write them into a folder: names of the files. relit: the splats in that light."""
        names: list[str] = []
        if "probe" in self._kinds:
            from .probe_files import write_probes

            light = self._light(shaded)
            names += write_probes(folder, relit, self._scene, self._occluder, light, shaded.exposure, self._places)
        return names
