"""The shadow that a part casts on the rest of a capture: its new one by rays, and its captured one taken away.

The part is in the scene, and out of it: a pose in which its faces are gone. So the rest changes where the part stops
light that would come directly, and there by what it does to all light.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask
from splat2mesh.base.errors import InputError
from splat2mesh.scene.scene import Scene

from ..engine.appearance import Place
from ..engine.relighter import Relighter, Shaded
from .job import Job


class PartShadow:
    """The shadow of what takes the new light of a Job that has a part. Raises InputError for a scene without a known
    captured light, for a closed room and for a method without rays."""

    def __init__(self, job: Job) -> None:
        look, part = job.known.appearance, job.known.part
        if look.environment is None or look.place is not Place.OPEN:
            raise InputError("`shadow_of_parts`: expected an object or an open place whose captured light is estimated")
        assert part is not None  # of the job
        self._job, self._look, self._captured_in = job, look, look.environment
        self._without = _without(job.known.scene, part.vertices > 0.5)
        self._latest: tuple[Shaded, NDArray[np.float32]] | None = None

    def ratio(self, shaded: Shaded) -> NDArray[np.float32]:
        """(V, 3) by which the light of the capture changes on the rest, 1 where the part does not shade it."""
        if self._latest is None or self._latest[0].light is not shaded.light:
            self._latest = shaded, self._found(shaded)
        return self._latest[1]

    def _found(self, shaded: Shaded) -> NDArray[np.float32]:
        relighter, settings = self._job.known.relighter, shaded.shading.settings
        if settings.method != "raytraced":
            raise InputError(f"`shadow_of_parts`: rays cast it, and the method is {settings.method}")
        present, absent = (
            self._lights(relighter.posed(scene, settings), shaded) for scene in (relighter.scene, self._without)
        )
        (new, captured), (new_without, captured_without) = present[1], absent[1]
        shades = np.any([a != b for a, b in zip(present[0], absent[0], strict=True)], axis=(0, 2))
        ratio = np.ones_like(new)
        above, below = (new * captured_without)[shades], (new_without * captured)[shades]
        ratio[shades] = np.divide(above, below, out=np.ones_like(above), where=below > 0.0)
        return ratio

    def _lights(self, relighter: Relighter, shaded: Shaded) -> tuple[list[NDArray[np.float32]], list[NDArray]]:
        """Direct light of the new and the captured sky on a pose, (V, 3), and irradiance over pi by all light."""
        job, look = self._job.posed(relighter, self._look), self._look
        lit = job.beside(Shaded(shaded.light, job.shading(shaded.light), shaded.exposure)).shading
        captured = relighter.shading(self._captured_in, look.albedo)
        direct = [
            relighter.direct(light, shading.settings)[0]
            for light, shading in ((shaded.light, lit), (self._captured_in, captured))
        ]
        new = look.received(lit.radiance, shaded.exposure) if lit.received is None else lit.received
        return direct, [new, look.received(captured.radiance)]


def _without(scene: Scene, gone: Mask) -> Scene:
    """A pose of a Scene without the faces of some of its vertices, (V,) bool, which count as moved: by one rounding."""
    chunks, start = [], 0
    for chunk in scene.chunks:
        rows = gone[start : start + len(chunk.vertices)]
        vertices = np.where(rows[:, None], np.nextafter(chunk.vertices, np.float32(np.inf)), chunk.vertices)
        chunks.append(replace(chunk, vertices=vertices, faces=chunk.faces[~rows[chunk.faces].any(axis=1)]))
        start += len(chunk.vertices)
    return replace(scene, chunks=chunks, path=None)
