"""Results that depend on the geometry alone: computed on first use, extended, not repeated, kept between runs."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np

from splat2mesh.base.arrays import Transfer
from splat2mesh.scene.scene import Scene

from .analytic import analytic
from .kept import SURFACES, Key, key_of, restored, serves, stands_for
from .kept_bounces import KeptBounces
from .neighbors import Neighbors
from .neuralgash import neural_gash
from .occluder import Occluder
from .receivers import Receivers
from .settings import Settings
from .store import Cache
from .visibility import Visibility
from .volume import Foliage

KEPT_IN_MEMORY = 2  # transfers of different settings: of a million vertices in 8 bands each takes 256 MB


class Precomputed(KeptBounces):
    """Occluder, visibility, transfer and interreflection of a scene.

    A transfer of more bands or more rays than requested serves as well: its first bands are the transfer of fewer. From
    kept visibility, more bands need no ray and twice the rays only the new half. Rays that are too few to grow are
    traced again. rays_traced: how many rays were shot for transfers and matrices so far. foliage: the Foliage of the
    scene, or None. shown: returns (V,) bool, the vertices whose light is shown; None for all of them.
    """

    sparing = True
    """Whether rays on whose outcome neighbours agree stay untraced."""

    def __init__(self, scene: Scene, *given: Any, **named: Any) -> None:
        """Arguments as of KeptBounces."""
        super().__init__(scene, *given, **named)
        self._visibility: Visibility | None = None
        self.foliage = Foliage.of_scene(scene)
        self._transfers: dict[Key, Transfer] = {}

    @property
    def _neighbors(self) -> Neighbors:
        """The Neighbors of the occluder."""
        return super()._neighbors if self._visibility is None else self._visibility.neighbors

    @property
    def _volumes(self) -> Foliage:
        assert self.foliage is not None  # no Settings have a volume without
        return self.foliage

    def there(self) -> Callable[[Settings], tuple[bool, bool]]:
        """A function of Settings: (whether their transfer takes no ray, whether their bounces take none), as of now."""
        keys = [*self._transfers, *self._keys()]
        keys, most = [each for each in keys if each[3] == self.seed], max(self._matrices(), default=0)

        def found(settings: Settings) -> tuple[bool, bool]:
            leaves = self._leaves(settings)
            return any(serves(each, settings, leaves) for each in keys), most >= settings.bounce_rays

        return found

    def transfer(self, settings: Settings) -> tuple[Transfer, Settings]:
        """(transfer (V, K) float32 of at least `settings.bands`, the Settings as done: with the rays it really has, and
        a volume only where the scene has one)."""
        settings = settings._replace(volume=settings.volume if self.foliage is not None else 0)
        for known, transfer in self._transfers.items():
            if serves(known, settings, self._leaves(settings)):
                return transfer, settings._replace(rays=known[2])
        found = self._kept(settings) or self._computed(settings)
        while len(self._transfers) >= KEPT_IN_MEMORY:
            self._transfers.pop(next(iter(self._transfers)))
        self._transfers[found[0]] = found[1]
        return found[1], settings._replace(rays=found[0][2])

    def alone(self, settings: Settings) -> "Precomputed":
        """The Precomputed whose results under these Settings have no more rays than they say: itself, or where more is
        there one that knows nothing of it. What follows from them does not depend on what ran before."""
        settings = settings._replace(volume=settings.volume if self.foliage is not None else 0)
        key, leaves = self._key(settings, settings.rays), self._leaves(settings)
        known = {each for each in (*self._transfers, *self._keys()) if each[3] == self.seed}
        serving, seen = {each for each in known if serves(each, settings, leaves)}, self._known_visibility(settings)
        wanted, as_wanted = settings.bounce_rays, serving == {key} if serving else seen is None
        others = {rays for rays in self._matrices() if rays >= wanted}
        if as_wanted and (not others or wanted in others):
            return self
        self._receivers = self.receivers  # found once, for both
        apart = copy.copy(self)
        apart.cache, apart._transfers, apart._interreflections = Cache(), {}, {}
        apart._visibility = seen.first if seen is not None and seen.base == settings.rays else None
        return apart

    def forget(self, settings: Settings) -> None:
        """Let go of what is in memory and does not serve these Settings: transfers, of which the next is computed, or
        read, from what was traced; and bounces of fewer rays."""
        leaves = self._leaves(settings)
        for key in [key for key in self._transfers if not serves(key, settings, leaves)]:
            gone = self._transfers.pop(key)
            for rays, (matrix, scaled_to) in list(self._interreflections.items()):
                if scaled_to is gone:
                    self._interreflections[rays] = matrix, None
        for rays in [rays for rays in self._interreflections if not 0 < settings.bounce_rays <= rays]:
            del self._interreflections[rays]

    def _kept(self, settings: Settings) -> tuple[Key, Transfer] | None:
        """(key, transfer) of the smallest kept transfer that serves, or None."""
        for key in sorted(self._keys(), key=lambda key: key[1:3]):
            if key[3] != self.seed or not serves(key, settings, self._leaves(settings)):
                continue
            receivers = self._rows_of(key[2])
            with self._stages.stage("transfer kept"):
                kept = self.cache.restored(lambda arrays: restored(arrays, key[1], receivers), "transfer", *key)  # noqa: B023
            if kept is not None:
                return key, kept
        return None

    def _computed(self, settings: Settings) -> tuple[Key, Transfer]:
        """(key, transfer) of what the settings ask for, or of more where more rays were there already."""
        method, bands, count, rays = settings.method, settings.bands, int(self.sizes.sum()), settings.rays
        if rays:
            visibility = self._seen(settings)
            rays = visibility.rays
            with self._stages.stage("transfer"):
                transfer = visibility.transfer(bands)
            if settings.volume:
                with self._stages.stage("volume"):
                    transfer = self._volumes.mixed(transfer, settings.volume, self.receivers.traced)
            transfer = self.receivers.filled(transfer)
        elif method == "neural-gash":
            with self._stages.stage("transfer", count) as advance:
                guess = neural_gash(self.scene.vertices, self.scene.normals, advance)
                transfer = np.ascontiguousarray(guess[:, : bands**2])
        else:
            with self._stages.stage("transfer"):
                return self._key(settings, 0), analytic(self.scene.normals, bands)  # quicker than reading it
        key = self._key(settings, rays)
        if self.cache.keeps:
            with self._stages.stage("keep"):
                kept = self._rows_of(rays)  # from which the others follow
                self.cache.put("transfer", *key, transfer=transfer if kept.all else transfer[kept.rows])
                for other in self._keys():
                    if other != key and stands_for(key, other):
                        self.cache.drop("transfer", *other)
        return key, transfer

    def _keys(self) -> list[Key]:
        """Keys of the cached transfers."""
        return [key for key in map(key_of, self.cache.settings_of("transfer")) if key is not None]

    def _rows_of(self, rays: int) -> Receivers:
        """The vertices that a transfer of so many rays was made for; one without rays is made for all."""
        return self.receivers if rays else Receivers.every(int(self.sizes.sum()))

    def _seen(self, settings: Settings) -> "Visibility":
        """The Visibility with a number of rays, grown from the existing one if possible."""
        mask = self._volumes.solid if settings.volume else None  # leaves and grass need no rays
        if not self.receivers.all:
            mask = self.receivers.traced if mask is None else mask & self.receivers.traced
        traced = int(self.sizes.sum() if mask is None else mask.sum())
        name, visibility = self._name(settings), self._known_visibility(settings)
        if visibility is not None and visibility.reaches(settings.rays):
            before, shot = visibility.rays, visibility.shot
            with self._stages.stage("rays", traced) as advance:
                while visibility.rays < settings.rays:
                    visibility.double(advance)
            new, shot = visibility.rays - before, visibility.shot - shot
        else:
            occluder = self.occluder
            with self._stages.stage("rays", traced) as advance:
                visibility = Visibility(occluder, settings.rays, self.seed, mask, advance, self.sparing)
            visibility.name = name
            new, shot = visibility.rays, visibility.shot
        self._visibility = visibility
        self.rays_traced += shot
        if new and self.cache.keeps:
            with self._stages.stage("keep"):
                bits = np.stack(visibility.bits)
                self.cache.put("visibility", *name, base=visibility.base, bits=bits, traced=visibility.traced)
        return visibility

    def _known_visibility(self, settings: Settings) -> "Visibility | None":
        """The Visibility that is there for such Settings, of however many rays, or None."""
        name, visibility = self._name(settings), self._visibility
        if visibility is not None:
            return visibility if visibility.name == name else None
        if not self.cache.settings_of("visibility"):
            return None
        occluder, seed = self.occluder, self.seed
        visibility = self.cache.restored(
            lambda kept: Visibility.restored(occluder, int(kept["base"]), seed, kept["bits"], kept["traced"]),
            "visibility",
            *name,
        )
        if visibility is not None:
            visibility.name, visibility.sparing = name, self.sparing
        return visibility

    def _name(self, settings: Settings) -> tuple[int, str]:
        """What a Visibility for such Settings is kept under."""
        leaves = self._volumes.key if settings.volume else SURFACES
        return self.seed, self._with_receivers(leaves)

    def _leaves(self, settings: Settings) -> str:
        """Text for a file's name that identifies the volumes."""
        leaves = f"{self._volumes.key}x{settings.volume}" if settings.volume else SURFACES
        return self._with_receivers(leaves) if settings.rays else leaves

    def _with_receivers(self, text: str) -> str:
        """Text for a file's name, with the key of the traced vertices unless they are all."""
        return text if self.receivers.all else f"{self.receivers.key}x{text}"

    def _key(self, settings: Settings, rays: int) -> Key:
        """The key of a transfer, as in its file."""
        return settings.method.replace("-", "_"), settings.bands, rays, self.seed, self._leaves(settings)


class PosedPrecomputed(Precomputed):
    """A Precomputed of the same vertices in another pose. Leaves and grass keep the light of the first one.

    Each vertex keeps its frame, its rank and so its rays, which are all traced: of a vertex that rests, those that the
    motion does not reach meet what they met, to the bit.
    """

    sparing = False

    def __init__(self, first: Precomputed, scene: Scene) -> None:
        super().__init__(scene, first.seed, stages=first._stages)
        self.foliage, self._receivers = first.foliage, first.receivers
        self._occluder = Occluder(scene.vertices, scene.normals, scene.faces, first.occluder)
