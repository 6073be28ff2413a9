"""Files on the surrounding light: probes of it, and the changes that objects make to it."""

from ..insert.probe import LightAround, ProbedScene
from .catcher_files import write_catcher
from .probe_files import write_probes
from .relit_splats import RelitSource
from .subject import LitFolder, WrittenScene


class AroundFiles:
    """Writes those of `kinds.AROUND`. relit: of the same scene."""

    def __init__(self, written: WrittenScene, relit: RelitSource) -> None:
        self._written, self._relit = written, relit

    def write(self, into: LitFolder) -> list[str]:
        """Write them; returns the names of the files."""
        if into.relit is None:
            return []
        names: list[str] = []
        written, asked, shaded = self._written, self._written.asked, into.shaded
        with written.stages.stage("around"):
            if "probe" in asked.kinds:
                assert written.light_around is not None
                light: LightAround = written.light_around(shaded)
                probed = ProbedScene(into.relit, written.scene, written.relighter.occluder, light, shaded.exposure)
                names += write_probes(into.path, probed, asked.probe_at, asked.probe_grid)
            if "catcher" in asked.kinds and shaded.inserted is not None:
                looks = self._relit.without_objects(shaded), into.relit
                names += write_catcher(into.path, *looks, written.scene, shaded.inserted, written.source_file)
        return names
