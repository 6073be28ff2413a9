"""The background of a city outside all tiles: the sky, which shows the new light, and distant lawns and houses, which
take the change of light of the city as seen from there."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.scene import Scene
from splat2mesh.splats.joining import joined
from splat2mesh.splats.splats import Splats
from splat2mesh.tiles.store import Store
from splat2mesh.tiles.survey import SAMPLE, splats_from

from ..light.environment import Environment
from ..splats.attachment import Patches, Surface
from ..splats.light_ratio import log_gain, relit_sh
from ..splats.sky import Backdrop, FarSplats, backdrop_of, is_sky


class Background(NamedTuple):
    """The light on far splats, the same for all pieces. backdrop: of the captured splats. patches: change of light of
    the city as seen from afar. mean: (3,) of all patches."""

    backdrop: Backdrop
    patches: Patches
    mean: NDArray[np.float32]


def far_splats(store: Store, piece: int, most: int | None = None) -> Splats:
    """The far background of a piece: all rows, or an even sample of at most `most`."""
    kept = store.read_arrays(f"splats/far_{piece:05d}.npz")
    step = 1 if most is None else max(1, -(-len(kept["means"]) // most))
    return splats_from(kept, slice(None, None, step))


def background_of(
    store: Store,
    pieces: list[int],  # that hold far splats
    scene: Scene,  # the city, coarse
    before: NDArray,  # (V, 3) of its vertices, as `log_gain` takes it
    after: NDArray,  # (V, 3), exposure applied
) -> Background | None:
    """The Background of a city; None without far splats."""
    samples = [far_splats(store, piece, max(SAMPLE // len(pieces), 1)) for piece in pieces]
    sample = joined([Splats(s.means, s.scales, s.quats_wxyz, s.opacities, s.sh[:, :1]) for s in samples])
    sample = sample.take(np.isfinite(sample.means).all(axis=1))
    if not len(sample):
        return None
    surface = Surface(scene)
    shares = (surface.areas / np.bincount(surface.node))[surface.node]
    logs, mean = log_gain(scene.colors_linear, before, after, shares)
    up = np.asarray(scene.scene_from_splat, np.float64)[1, :3]
    backdrop = backdrop_of(sample, np.median(surface.points[surface.used], axis=0), up)
    return Background(backdrop, Patches.of(surface, surface.of_vertices(logs)), mean)


def relit_background(
    splats: Splats,  # of a piece, every row
    background: Background,
    sky: Environment,
    scene_from_splat: NDArray,  # (4, 4)
    exposure: float,
    choice: str,  # of `splats.SKIES`
) -> Splats:
    """Far splats under the new light; non-finite splats stay. Under the captured light they take `exposure` as factor,
    since no lamp reaches that far."""
    finite = np.isfinite(splats.means).all(axis=1)
    if choice == "keep" or not finite.any():
        return splats
    rows = np.flatnonzero(finite)
    shown = is_sky(splats.take(rows), background.backdrop)
    other, sh = rows[~shown], splats.sh.copy()
    sh[other] = relit_sh(sh[other], background.patches.seen_from(splats.means[other]), background.mean)
    relit = replace(splats, sh=sh)
    eye = background.backdrop.middle
    return FarSplats(splats, rows[shown], rows, scene_from_splat, choice, eye).under(relit, sky, exposure)
