"""clean_splat.ply: the source splats of a scene without floaters."""

from functools import cached_property

import numpy as np

from splat2mesh.base.arrays import Mask
from splat2mesh.splats.formats import can_hold, kind_of, write_splats
from splat2mesh.splats.formats.selected import write_selected

from ..splats.floaters import floaters
from .kinds import FILES
from .subject import LitFolder, WrittenScene


class CleanFiles:
    """Writes the splats of a scene without floaters, in whatever light."""

    def __init__(self, written: WrittenScene, _: object) -> None:
        self._written = written

    @cached_property
    def keep(self) -> Mask:
        """(N,) bool: the splats that are no floaters."""
        splats, stages = self._written.source, self._written.stages
        assert splats is not None  # else nobody asks
        with stages.stage("floaters"):
            kept = np.ones(len(splats), bool)
            kept[floaters(splats, self._written.scene)] = False
            return kept

    def write(self, into: LitFolder) -> list[str]:
        """Write them, with their entry in the report; returns the names of the files.

        The rows of a PLY stay as they are to the bit, with all their properties; what was read of any other kind is
        written as a PLY, and where that kind has a writer as that too.
        """
        name, keep, splats, source = FILES["clean-splat"], self.keep, self._written.source, self._written.source_file
        assert splats is not None
        into.facts["clean_splat"] = {"splats": len(keep), "floaters": int(np.count_nonzero(~keep))}
        kind = "tiles" if source is None else kind_of(source)
        with self._written.stages.stage("write"):
            if source is not None and kind == "ply":
                write_selected(into.path / name, source, keep)
                return [name]
            kept = splats.take(np.flatnonzero(keep))
            write_splats(into.path / name, kept)
            if not can_hold(kind, kept):
                return [name]
            write_splats(into.path / f"clean_splat.{kind}", kept, kind)
        return [name, f"clean_splat.{kind}"]
