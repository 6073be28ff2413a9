"""What depends on a scene's geometry alone: computed on first use, extended rather than repeated, kept between runs."""

import numpy as np

from .analytic import analytic
from .bounces import Interreflection, visible_fraction
from .store import Cache, array_key
from .volume import Foliage

KEPT_IN_MEMORY = 2  # transfers of different settings: of a million vertices in 8 bands each takes 256 MB

SURFACES = "surfaces"  # instead of the key of a Foliage


class Precomputed:
    """Occluder, visibility, transfer and interreflection of a scene.

    A transfer of more bands or more rays than are asked for serves as well: its first bands are the transfer of fewer.
    From kept visibility, more bands need no ray and twice the rays only the new half. Rays that are too few to grow
    are traced anew. rays_traced: how many rays were shot for transfers and matrices so far. foliage: the Foliage of the
    scene, or None.
    """

    def __init__(self, scene, seed, cache=None, stages=None):
        from splat2mesh.base.progress import Stages

        self.scene, self.seed = scene, seed
        self.sizes = np.array([len(chunk.vertices) for chunk in scene.chunks])
        self.cache = Cache() if cache is None else cache
        self.rays_traced = 0
        self._stages = stages or Stages()
        self._occluder = self._visibility = None
        self.foliage = Foliage.of_scene(scene)
        self._transfers, self._interreflections = {}, {}

    @property
    def occluder(self):
        """The Occluder of the whole scene."""
        if self._occluder is None:
            from .occluder import Occluder

            with self._stages.stage("occluder"):
                self._occluder = Occluder(self.scene.vertices, self.scene.normals, self.scene.faces)
        return self._occluder

    def transfer(self, settings):
        """(transfer (V, K) float32 of at least `settings.bands`, the Settings as done: with the rays it really has, and
        a volume only where the scene has one)."""
        settings = settings._replace(volume=settings.volume if self.foliage is not None else 0)
        for known, transfer in self._transfers.items():
            if _serves(known, settings, self._leaves(settings)):
                return transfer, settings._replace(rays=known[2])
        found = self._kept(settings) or self._computed(settings)
        while len(self._transfers) >= KEPT_IN_MEMORY:
            self._transfers.pop(next(iter(self._transfers)))
        self._transfers[found[0]] = found[1]
        return found[1], settings._replace(rays=found[0][2])

    def interreflection(self, rays, transfer):
        """The Interreflection of the scene, so many rays per vertex; rows complement what `transfer` sees."""
        if rays not in self._interreflections:
            self._interreflections[rays] = [self._matrix(rays, visible_fraction(transfer)), transfer]
        matrix, scaled_to = self._interreflections[rays]
        if scaled_to is not transfer:
            matrix.scale_to(visible_fraction(transfer))
            self._interreflections[rays][1] = transfer
        return matrix

    def _matrix(self, rays, visible):
        """The Interreflection, kept from before or computed."""
        with self._stages.stage("bounce rays kept"):
            kept = self.cache.restored(
                lambda arrays: Interreflection.restored(rays, arrays, visible), "bounces", rays, self.seed
            )
        if kept is not None:
            return kept
        occluder = self.occluder
        with self._stages.stage("bounce rays", len(visible)) as advance:
            found = Interreflection(occluder, rays, self.seed, visible, advance)
        self.rays_traced += rays * len(visible)
        with self._stages.stage("keep"):
            self.cache.put("bounces", rays, self.seed, **found.arrays())
        return found

    def _kept(self, settings):
        """(key, transfer) of the smallest kept transfer that serves, or None."""
        for key in sorted(filter(None, map(_key_of, self.cache.settings_of("transfer"))), key=lambda key: key[1:3]):
            if key[4] != self.seed or not _serves(key, settings, self._leaves(settings)):
                continue
            shape = int(self.sizes.sum()), key[1] ** 2
            with self._stages.stage("transfer kept"):
                kept = self.cache.restored(lambda arrays: _transfer(arrays, shape), "transfer", *key)  # noqa: B023
            if kept is not None:
                return key, kept
        return None

    def _computed(self, settings):
        """(key, transfer) of what the settings ask for, or of more where more rays were there already."""
        method, bands, count, rays = settings.method, settings.bands, int(self.sizes.sum()), settings.rays
        if rays:
            visibility = self._seen(settings)
            rays = visibility.rays
            with self._stages.stage("transfer"):
                if method == "neural":
                    from .neural import from_visibility

                    transfer = from_visibility(visibility, bands)[0]
                else:
                    transfer = visibility.transfer(bands)
            if settings.volume:
                with self._stages.stage("volume"):
                    transfer = self.foliage.mixed(transfer, settings.volume)
        elif method == "neural-gash":
            from .neuralgash import neural_gash

            with self._stages.stage("transfer", count) as advance:
                guess = neural_gash(self.scene.vertices, self.scene.normals, advance)
                transfer = np.ascontiguousarray(guess[:, : bands**2])
        else:
            with self._stages.stage("transfer"):
                return self._key(settings, 0), analytic(self.scene.normals, bands)  # quicker than reading it
        key = self._key(settings, rays)
        with self._stages.stage("keep"):
            self.cache.put("transfer", *key, transfer=transfer)
        return key, transfer

    def _seen(self, settings):
        """The Visibility with so many rays: what there is, grown if it can be."""
        from .visibility import Visibility

        mask = None if settings.shadowed is None else np.repeat(settings.shadowed, self.sizes)
        if settings.volume:  # leaves and grass need no rays
            mask = self.foliage.solid if mask is None else mask & self.foliage.solid
        traced = int(self.sizes.sum() if mask is None else mask.sum())
        name = _chunks_text(settings.shadowed), self.seed, self.foliage.key if settings.volume else SURFACES
        visibility = self._visibility
        if visibility is None:
            occluder, seed = self.occluder, self.seed
            visibility = self.cache.restored(
                lambda kept: Visibility.restored(occluder, int(kept["base"]), seed, kept["bits"], kept["traced"]),
                "visibility",
                *name,
            )
            if visibility is not None:
                visibility.name = name
        if visibility is not None and visibility.name == name and visibility.reaches(settings.rays):
            before = visibility.rays
            with self._stages.stage("rays", traced) as advance:
                while visibility.rays < settings.rays:
                    visibility.double(advance)
            new = visibility.rays - before
        else:
            occluder = self.occluder
            with self._stages.stage("rays", traced) as advance:
                visibility = Visibility(occluder, settings.rays, self.seed, mask, advance)
            visibility.name = name
            new = visibility.rays
        self._visibility = visibility
        if new:
            self.rays_traced += new * traced
            with self._stages.stage("keep"):
                bits = np.stack(visibility.bits)
                self.cache.put("visibility", *name, base=visibility.base, bits=bits, traced=visibility.traced)
        return visibility

    def _leaves(self, settings):
        """Text for a file's name that tells volumes apart."""
        return f"{self.foliage.key}x{settings.volume}" if settings.volume else SURFACES

    def _key(self, settings, rays):
        """What a transfer is told apart by, as its file is named."""
        method, chunks = settings.method.replace("-", "_"), _chunks_text(settings.shadowed)
        return method, settings.bands, rays, chunks, self.seed, self._leaves(settings)


def _transfer(kept, shape):
    """The transfer of what was kept. Raises ValueError for another shape or type, and unless it is finite."""
    transfer = kept["transfer"]
    if transfer.shape != shape or transfer.dtype != np.float32 or not np.isfinite(transfer).all():
        raise ValueError(f"expected float32 of shape {shape}, found {transfer.dtype} of {transfer.shape}")
    return transfer


def _key_of(texts):
    """The key that a file's name was made of, or None for another's file."""
    try:
        method, bands, rays, chunks, seed, leaves = texts
        return method, int(bands), int(rays), chunks, int(seed), leaves
    except ValueError:
        return None


def _serves(key, settings, leaves):
    """Whether the transfer of a key is as good as that of the settings, or better."""
    method, bands, rays, chunks, _, as_leaves = key
    if (
        as_leaves != leaves
        or method != settings.method.replace("-", "_")
        or bands < settings.bands
        or rays < settings.rays
    ):
        return False
    return chunks in ("all", _chunks_text(settings.shadowed))


def _chunks_text(shadowed):
    """The chunks with shadows as text for a file's name."""
    if shadowed is None:
        return "all"
    return array_key(np.array(shadowed))
