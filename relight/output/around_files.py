"""Files on the surrounding light: probes of it, and the changes that objects make to it."""

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
    from ..insert.probe_grid import ProbeGrid


class AroundFiles:
    """Writes these files of a scene, light after light.

    kinds: words of `kinds.AROUND`, and others. light: returns the Light of one of the lights. places: of probes, in the
    frame of the splats; with a grid, what it lies about. source: the file that these were read from, where it is one.
    """

    def __init__(
        self,
        scene: Scene,
        occluder: Occluder,
        kinds: Sequence[str],
        light: "Callable[[Shaded], Light]",
        places: "Sequence[Vector]" = (),
        source: Path | None = None,
        grid: "ProbeGrid | None" = None,
    ) -> None:
        self._scene, self._occluder, self._kinds = scene, occluder, kinds
        self._light, self._places, self._grid = light, list(places), grid
        self._source = source

    def write(
        self,
        folder: Path,
        relit: Splats,
        shaded: "Shaded",
        without: Callable[[], Splats],
        size: tuple[int, int],
    ) -> list[str]:
        """Write them into a folder: names of the files.

        relit: the splats in that light. without: returns them without what objects change. size: of pictures.
        """
        names: list[str] = []
        if "probe" in self._kinds:
            from .probe_files import write_probes

            light = self._light(shaded)
            how = light, shaded.exposure, self._places, self._grid
            names += write_probes(folder, relit, self._scene, self._occluder, *how)
        if "catcher" in self._kinds and shaded.inserted is not None:
            from .catcher_files import write_catcher

            names += write_catcher(folder, without(), relit, self._scene, shaded.inserted, size, self._source)
        return names
