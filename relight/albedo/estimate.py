"""The light that a scene was captured in and the albedo of its surfaces, both from the captured colours.

C = a S, S = D(light) + B C: what a surface receives from others is what they were seen to send, so that only the
light from outside is unknown. `evidence` says how well a light explains the capture, `natural` which lights are usual,
and `posterior` finds the lights that may have lit it. Unit: that of C.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.progress import Advance

from ..light import projections
from ..light.environment import Environment
from ..transfer.occluder import Occluder
from ..transfer.transport import Transport
from . import posterior
from .captured import HEIGHT, WIDTH, CapturedScene, CaptureEvidence, Estimate
from .division import Prior, albedo_of
from .natural import AXES, NaturalLight, log_harmonics, natural_light
from .refined import refined
from .said import Said
from .skylight import exposure_of, visible_part

MIN_EVIDENCE = 0.5
"""Below it the prior, not the capture, decides where the light comes from, and it is not separated from the albedo."""

SUNLESS = ("overcast", "shade", "night")
"""Skies without a sun."""


def estimate(
    occluder: Occluder,
    captured: ArrayLike,  # (V, 3) linear exit radiance as captured, any unit
    seed: int = 0,
    advance: Advance = lambda count: None,  # called with the number of vertices done, twice for each
    transport: Transport | None = None,  # existing results for the white scene
    evidence: CaptureEvidence | None = None,  # facts of the capture beside its colours
) -> Estimate:
    """Estimate albedo and light of a scene captured in unknown light: the mean of the posterior.

    Deterministic; the order of vertices and chunks affects only the last bits. Non-finite colours count as black.
    Raises InputError unless `captured` is (V, 3).
    """
    given = evidence or CaptureEvidence()
    scene = CapturedScene(occluder, captured, seed, advance, transport, given)
    problem = given.hopeless or scene.problem()
    if problem:
        return scene.as_captured(problem)
    said = given.said
    lights = posterior.lights_of(scene.evidence, _prior(said), said.sun, said.sun is None and said.sky in SUNLESS)
    spread = posterior.spread(scene.evidence, lights)
    lights = refined(scene.evidence, lights)
    decided = lights[0].decided if scene.sky is None else visible_part(scene.sky)
    if scene.sky is None and decided < MIN_EVIDENCE and said.sun is None and said.sky is None:
        return scene.as_captured("its surfaces face too few directions to separate light from colour", decided)
    directions = projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)
    image = posterior.mean_radiance(lights, directions).reshape(HEIGHT, WIDTH, 3).astype(np.float32)
    found = scene.result(Environment(image, "estimated"), decided)
    return found._replace(spread=spread, lights=tuple(lights))


def with_known_light(
    occluder: Occluder,
    captured: ArrayLike,
    environment: Environment,
    seed: int = 0,
    advance: Advance = lambda count: None,
    transport: Transport | None = None,
    evidence: CaptureEvidence | None = None,
) -> Estimate:
    """Albedo of a scene captured under a known Environment, whose exposure is found: an Estimate.

    Where a captured sky shows enough of that light, it determines the exposure, else the usual albedo does. One that is
    `exposed` is taken as is. Arguments and errors as of `estimate`.
    """
    scene = CapturedScene(occluder, captured, seed, advance, transport, evidence)
    problem = scene.problem()
    direct = scene.direct(environment)
    if not problem and not (np.median(direct[scene.places.vertices], axis=0) > 0.0).all():
        problem = f"the light {environment.name} does not reach it in all three colours"
    if problem:
        return scene.as_captured(problem)
    if environment.exposed:
        return scene.result(environment, 1.0, direct)
    measured = None if scene.sky is None else exposure_of(scene.sky, environment)
    if measured is not None:
        seen = Environment(environment.radiance * measured, environment.name, environment.rotation_deg)
        return scene.result(seen, 1.0, direct * measured)
    shown = np.maximum(environment.lookup(scene.places.directions).astype(np.float64), 1e-9)
    gain = np.float32(np.exp(scene.evidence.lacking(np.log(shown))))
    scaled = Environment(environment.radiance * gain, environment.name, environment.rotation_deg)
    return scene.result(scaled, 1.0, direct * gain)


def under_light(
    occluder: Occluder,
    captured: ArrayLike,
    environment: Environment,
    prior: Prior | None,
    seed: int = 0,
    transport: Transport | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Albedo and irradiance, (V, 3) float32 each, of part of a scene whose light and Prior were estimated before.

    environment: that of an Estimate, which is in the unit of the captured colours. Other arguments as of `estimate`.
    """
    scene = CapturedScene(occluder, captured, seed, lambda count: None, transport)
    irradiance = scene.direct(environment) + scene.bounce
    return albedo_of(scene.captured, irradiance, prior), irradiance


def _prior(said: Said) -> NaturalLight:
    """The NaturalLight of what a person says of the sky."""
    if said.sky is None or isinstance(said.sky, str):
        return natural_light(said.sky)
    image = said.sky.lookup(projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)).reshape(HEIGHT, WIDTH, 3)
    return NaturalLight(log_harmonics(image) @ np.linalg.inv(AXES).T, natural_light().precision)
