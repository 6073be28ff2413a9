"""clean_splat.ply: the source splats of a scene without floaters."""

from functools import cached_property
from pathlib import Path

import numpy as np

from splat2mesh.base.arrays import Mask
from splat2mesh.base.progress import Stages
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import can_hold, kind_of, write_splats
from splat2mesh.splats.formats.selected import write_selected
from splat2mesh.splats.splats import Splats

from ..splats.floaters import floaters
from .kinds import FILES


class CleanFiles:
    """Writes the splats of a scene without floaters, in whatever light.

    splats, paths: as of `source_splats`. stages: Stages that time the work.
    """

    def __init__(self, scene: Scene, splats: Splats, paths: list[Path], stages: Stages) -> None:
        self._scene, self._splats, self._paths, self._stages = scene, splats, paths, stages

    @cached_property
    def keep(self) -> Mask:
        """(N,) bool: the splats that are no floaters."""
        with self._stages.stage("floaters"):
            kept = np.ones(len(self._splats), bool)
            kept[floaters(self._splats, self._scene)] = False
            return kept

    @property
    def report(self) -> dict[str, int]:
        """Their entry in the report."""
        return {"splats": len(self.keep), "floaters": int(np.count_nonzero(~self.keep))}

    def write(self, folder: Path) -> list[str]:
        """Write them into a folder: names of the files.

        The rows of a PLY stay as they are to the bit, with all their properties; what was read of any other kind is
        written as a PLY, and where that kind has a writer as that too.
        """
        name, keep = FILES["clean-splat"], self.keep
        source = self._paths[0] if len(self._paths) == 1 else None
        kind = "tiles" if source is None else kind_of(source)
        with self._stages.stage("write"):
            if source is not None and kind == "ply":
                write_selected(folder / name, source, keep)
                return [name]
            kept = self._splats.take(np.flatnonzero(keep))
            write_splats(folder / name, kept)
            if not can_hold(kind, kept):
                return [name]
            write_splats(folder / f"clean_splat.{kind}", kept, kind)
        return [name, f"clean_splat.{kind}"]
