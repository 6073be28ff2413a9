"""The light of a capture under a sky of which the capture shows a part."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Vector
from splat2mesh.scene.color import luminance
from splat2mesh.scene.measured import CapturedSky

from ..light import projections
from ..light.environment import Environment
from . import contrast, edges, fit, skylight, sun
from .captured import HEIGHT, WIDTH, CapturedScene
from .patches import ColorPatches


class SkyLit(NamedTuple):
    """The Environment of a capture under its sky; sure: whether that sky, or a sun found by its shadows, decided it.
    edged: whether the edges of shadows show that sun. ambiguity: as of Estimate."""

    environment: Environment
    sure: bool
    edged: bool = False
    ambiguity: float = 0.0


def light_under_sky(scene: CapturedScene, sky: CapturedSky, volume: Floats | None = None) -> SkyLit | None:
    """The SkyLit of a CapturedScene under a CapturedSky; None where that shows little and colours add nothing.

    volume: as in `estimate`. Not sure where the sky shows little, nobody stood within, and no sun is found.
    """
    seen, sky = skylight.visible_part(sky), skylight.unmixed(sky)
    places, within, little = scene.places, scene.looks is not None, seen < skylight.LITTLE_VISIBLE
    parts = skylight.SkyParts.at(sky, places.directions)
    light = skylight.SkyLight(places.sky, parts, places.directions, scene.bounced())
    colors = scene.captured[places.vertices].astype(np.float64)
    start = skylight.start_of(light, parts, places.directions, colors, scene.start())
    patches = scene.patches(volume) if within or little else None
    if patches is not None:
        found = _by_contrast(scene, patches, sky, parts, start, volume)
        return found._replace(sure=within or found.sure)
    return None if little else SkyLit(_by_pairs(scene, sky, light, start), True)


def beside_alone(scene: CapturedScene, light: SkyLit, alone: Environment) -> SkyLit:
    """The SkyLit half of one that is not sure, half of the Environment estimated from colours without a sky.

    The latter as bright as the former, in the median irradiance of the places: pairs of places show no brightness.
    """
    under, other = (luminance(scene.direct_at_places(each)) for each in (light.environment, alone))
    gain = np.float32(np.median(under) / max(float(np.median(other)), 1e-9))
    radiance = 0.5 * (light.environment.radiance + gain * alone.radiance)
    return SkyLit(Environment(radiance.astype(np.float32), "estimated"), False)


def _by_pairs(
    scene: CapturedScene, sky: CapturedSky, light: skylight.SkyLight, start: NDArray[np.float64]
) -> Environment:
    """The Environment: the part that a CapturedSky binds, and the rest as pairs of places show it."""
    places, prior = scene.places, skylight.prior_of(fit.prior_of)
    found = scene.fitted(light, start, prior)

    def radiance(directions: Directions, theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return skylight.radiance(skylight.SkyParts.looked_up(sky, directions), theta, directions)

    theta, lamp = sun.with_sun(
        *(scene.occluder, places, scene.log_captured(), sun.SunlessLight(light, start, prior, found)),
        least_gain=skylight.LEAST_SUN_GAIN,
        brightness=lambda directions: luminance(radiance(directions, found.theta)[1]),
    )
    known, free = radiance(projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3), theta)
    image = (known + free).reshape(HEIGHT, WIDTH, 3)
    if lamp is not None:
        image += sun.image_of(lamp, HEIGHT, WIDTH)
    return Environment(image.astype(np.float32), "estimated")


def _by_contrast(
    scene: CapturedScene,
    patches: ColorPatches,
    sky: CapturedSky,
    parts: skylight.SkyParts,
    start: NDArray[np.float64],
    volume: Floats | None,
) -> SkyLit:
    """The SkyLit of what a CapturedSky binds, and beyond it of what the contrast of patches shows; sure of a sun."""
    directions = scene.places.directions
    bound = luminance(skylight.without_excess(parts, start, directions))
    above = directions[:, 1] > 0.0
    unseen = np.where(above, parts.unseen.mean(axis=1), 0.0)
    texels = projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)
    looked_up = skylight.SkyParts.looked_up(sky, texels)
    image = skylight.without_excess(looked_up, start, texels)
    image, sunny, lamp, sharp = image.reshape(HEIGHT, WIDTH, 3), 0.0, None, None
    at_sun: edges.SunEdges | None = None

    def supported(direction: Vector) -> float:
        nonlocal at_sun
        at_sun = edges.sun_at_edges(scene, direction, volume)
        if at_sun is None:
            return 0.0
        return min(at_sun.nats, at_sun.nats_of_depth) if within else at_sun.nats_of_depth

    # More even shares and the doubt by edges were measured in scenes with eyes within alone.
    within, fewer = scene.looks is not None, contrast.CONTRAST.fewer if scene.looks is not None else 1.0
    clipped = parts.clipped.mean(axis=1)
    lights = contrast.brightness_of(patches, directions, bound, clipped, unseen, supported, fewer)
    for share, found in lights:
        region = looked_up.clipped + (looked_up.unseen * (texels[:, 1:2] > 0.0) if found.beyond else 0.0)
        more = region * found.excess * np.exp(texels @ found.lean)[:, None]
        image += share * more.reshape(HEIGHT, WIDTH, 3)
        if found.sun is not None:
            lamp = sun.Sun(found.sun, contrast.SUN_WIDTH_DEG, np.zeros(0), np.full(3, found.irradiance))
            image += share * sun.image_of(lamp, HEIGHT, WIDTH)
            sunny = share
    if lamp is not None and sunny > 0.5:
        rest = image - sunny * sun.image_of(lamp, HEIGHT, WIDTH)
        sharp = edges.sharpened(scene, Environment(rest.astype(np.float32), "estimated"), lamp, sunny, at_sun)
        if sharp is not None:
            image = _as_bright(scene, image, rest + sun.image_of(sharp, HEIGHT, WIDTH))
    unsure = 0.0 if sunny > 0.5 else contrast.ambiguity(patches, directions, bound, (clipped, unseen), lights)
    return SkyLit(Environment(image.astype(np.float32), "estimated"), sunny > 0.5, sharp is not None, unsure)


def _as_bright(scene: CapturedScene, before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance (H, W, 3) after a change of the sun, as bright as before in the median irradiance of the places; where
    eyes stood within, under more sky, not darker than it was seen."""
    lights = (Environment(each.astype(np.float32), "estimated") for each in (before, after))
    was, now = (float(np.median(luminance(scene.direct_at_places(each)))) for each in lights)
    gain = was / max(now, 1e-9)
    return after * (gain if scene.looks is None else max(gain, 1.0))
