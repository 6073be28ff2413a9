"""What follows from the geometry of a scene alone: its occluder, the vertices that light is traced for, and bounces."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Mask, Transfer
from splat2mesh.base.progress import Stages
from splat2mesh.scene.scene import Scene

from .bounce_places import BouncePlaces, Shooting
from .bounces import Interreflection, Sharing, visible_fraction
from .neighbors import Neighbors
from .occluder import Occluder
from .receivers import Receivers
from .store import Cache, array_key


class KeptBounces:
    """Occluder, receivers and interreflections of a scene, computed on first use and kept between runs.

    rays_traced: how many rays were shot so far. shown: returns (V,) bool, the vertices whose light is shown; None for
    all of them. solid: set by the owner of a room, a function of its Occluder: what `Occluder.shut` takes.
    """

    solid: "Callable[[Occluder], NDArray[np.float32]] | None" = None

    def __init__(
        self,
        scene: Scene,
        seed: int,
        cache: Cache | None = None,
        stages: Stages | None = None,
        shown: Callable[[], Mask] | None = None,
    ) -> None:
        self.scene, self.seed = scene, seed
        self.sizes = np.array([len(chunk.vertices) for chunk in scene.chunks])
        self.cache = Cache() if cache is None else cache
        self.rays_traced = 0
        self._stages = stages or Stages()
        self._occluder: Occluder | None = None
        self._receivers: Receivers | None = None
        self._shown = shown
        self._interreflections: dict[int, tuple[Interreflection, Transfer | None]] = {}  # and its scale

    @property
    def occluder(self) -> "Occluder":
        """The Occluder of the whole scene."""
        if self._occluder is None:
            with self._stages.stage("occluder"):
                self._occluder = Occluder(self.scene.vertices, self.scene.normals, self.scene.faces)
                if self.solid is not None:
                    self._occluder.shut(self.solid(self._occluder))
        return self._occluder

    @property
    def _neighbors(self) -> Neighbors:
        """The Neighbors of the occluder."""
        occluder = self.occluder
        return Neighbors(occluder.origins, occluder.normals, occluder.faces, occluder.ranked)

    @property
    def receivers(self) -> Receivers:
        """The Receivers of the scene."""
        if self._receivers is None:
            self._receivers = self._found() if self._shown is not None else Receivers.every(int(self.sizes.sum()))
        return self._receivers

    @property
    def partly(self) -> bool:
        """Whether light is found exactly only where it is shown."""
        return self._shown is not None

    @property
    def traced(self) -> Mask | None:
        """(V,) bool, the vertices that light is traced for; None for all."""
        return None if self.receivers.all else self.receivers.traced

    def _found(self) -> Receivers:
        assert self._shown is not None  # else all are traced
        shown, occluder = self._shown(), self.occluder
        key = array_key(shown)
        with self._stages.stage("receivers"):
            found = self.cache.restored(lambda kept: Receivers.restored(kept, shown), "receivers", key)
            if found is None:
                found = Receivers.of_shown(shown, occluder)
                self.cache.put("receivers", key, **found.arrays())
        return found

    def begin(self) -> None:
        """Begin to read the only Interreflection that is kept, beside other work."""
        kept = self._matrices() if self._shown is None else []
        if len(kept) == 1 and not self._interreflections:
            self.cache.begin("bounces", kept[0], self.seed, self.receivers.key)

    def _matrices(self) -> list[int]:
        """Numbers of rays of the interreflections, in memory or cached."""
        kept, name = self.cache.settings_of("bounces"), (self.seed, self.receivers.key)
        found = {each[0] for each in kept if each[1:] == name and type(each[0]) is int}
        return sorted(found | self._interreflections.keys())

    def interreflection(self, rays: int, transfer: Transfer) -> Interreflection:
        """The Interreflection of the scene, so many rays per vertex or more; rows complement what `transfer` sees."""
        for there in self._matrices():  # one that is kept may be gone by now: another run keeps one of more rays
            if there >= rays and (there in self._interreflections or self._restored(there, transfer)):
                rays = there
                break
        else:
            self._interreflections[rays] = self._matrix(rays, visible_fraction(transfer)), transfer
        matrix, scaled_to = self._interreflections[rays]
        if scaled_to is not transfer:
            matrix.scale_to(visible_fraction(transfer))
            self._interreflections[rays] = matrix, transfer
        return matrix

    def _restored(self, rays: int, transfer: Transfer) -> bool:
        """Take over the Interreflection of so many rays that is kept; whether there is one."""
        receivers, faces, visible = self.receivers, self.scene.faces, visible_fraction(transfer)

        def made(kept: Mapping[str, NDArray[Any]]) -> Interreflection:
            places = BouncePlaces.restored(kept, rays, len(faces), receivers.traced)
            return Interreflection.of_places(places, rays, self.occluder, visible, Sharing(receivers, self._neighbors))

        with self._stages.stage("bounce rays kept"):
            found = self.cache.restored(made, "bounces", rays, self.seed, receivers.key)
        if found is not None:
            self._interreflections[rays] = found, transfer
        return found is not None

    def _matrix(self, rays: int, visible: Floats) -> Interreflection:
        """The Interreflection, traced, and cached instead of those with fewer rays."""
        receivers = self.receivers
        with self._stages.stage("bounce rays", len(receivers.rows)) as advance:
            places = BouncePlaces.shot(rays, Shooting(self.occluder, self.seed, advance, receivers))
            sharing = Sharing(receivers, self._neighbors)
            found = Interreflection.of_places(places, rays, self.occluder, visible, sharing)
        self.rays_traced += rays * len(receivers.rows)
        with self._stages.stage("keep"):
            self.cache.put("bounces", rays, self.seed, receivers.key, **places._asdict())
            for fewer in self._matrices():
                if fewer < rays:
                    self.cache.drop("bounces", fewer, self.seed, receivers.key)
        return found
