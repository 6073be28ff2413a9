"""The light of a closed room as it was captured: its lamps, its windows, the albedo of its surfaces."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Mask, Radiance
from splat2mesh.scene.color import luminance, srgb_from_linear
from splat2mesh.scene.scene import Scene

from ..albedo import samples
from ..albedo.division import Prior, albedo_of, prior_of
from ..albedo.interior import within
from ..light.environment import Environment
from ..transfer.bounces import Interreflection, visible_fraction, with_bounces
from ..transfer.occluder import Frame, Occluder
from . import lamps, received, strengths
from .evenness import Evenness
from .pointing import lamps_at
from .seen import below_ceiling, seen_from
from .trust import trust_in
from .windows import WindowLight, capture_light, direct_light

LEAST_EVIDENCE = 0.5
"""Evidence below which an emitter cannot be separated from the colours of the surfaces it lights."""

LEAST_OF_WINDOWS = 0.8
"""The same for windows, whose sky has more freedom: colours at random have 0.73, rooms 0.91 to 0.98."""

ALBEDOS = 0.06, 0.85
"""Range of the median albedo, in luminance, of real rooms: outside it, light was missed or misunderstood."""

LEAST_EXCESS = 2.0
"""A lamp sends out at least this many times what it receives. A ceiling over a lamp is as white but sends out less;
how bright all lamps are together is known within a factor of two."""

LEAST_SEEN = 0.3
"""Share of a lamp's area that must have been seen from where the capture stood."""

AVERAGING_ROUNDS = 6
"""Rounds in which the light of a lamp is averaged over neighbours: scans of rooms have noisy normals."""


class Room(NamedTuple):
    """The light in a closed room, scene of V vertices, unit of the captured colours.

    albedo: (V, 3) float32. irradiance: (V, 3) float32, by which it gives the captured colours. by_lamps: (V, 3)
    float32, radiance of all that the lamps light, bounces included. glow: (V, 3) float32, emission of the lamps, 0
    elsewhere. lamp_light: (L, V, 3) float32, direct light of each lamp on white surfaces. lamp_of: (V,) int16, the lamp
    that a vertex belongs to, -1 for none. environment: the capture's, black without windows. brightness: luminance of
    the uniform sky that would bring as much light through the windows, 1 without. prior: of `albedo_of`. trust: (V,)
    float32, of `trust_in`: the share of its own change that a vertex takes, beside that of the whole room. report: dict
    for the report.
    """

    albedo: NDArray[np.float32]
    irradiance: NDArray[np.float32]
    by_lamps: NDArray[np.float32]
    glow: NDArray[np.float32]
    lamp_light: NDArray[np.float32]
    lamp_of: NDArray[np.int16]
    environment: Environment
    brightness: float
    prior: Prior
    trust: NDArray[np.float32]
    report: dict[str, Any]


class Pointed(NamedTuple):
    """Positions of lamps from the user. places: (P, 3) float64, scene frame. names: for messages."""

    places: NDArray[np.float64]
    names: list[str]


def room_of(
    scene: Scene,
    occluder: Occluder,
    captured: NDArray[np.float32],
    transfer: NDArray[np.float32],
    interreflection: Interreflection,
    seed: int = 0,
    pointed: Pointed | None = None,
    light: Environment | None = None,
) -> tuple[Room | None, str]:
    """Separate lamps, windows and albedo of a closed room from its captured colours.

    Parameters
    ----------
    scene : Scene
        Captured from within.
    occluder : Occluder
        The same scene to trace rays in, V vertices.
    captured : ndarray of float32, (V, 3)
        Linear.
    transfer : ndarray of float32, (V, K)
        Transfer of the white scene, without bounces.
    interreflection : Interreflection
        Bounces in the same scene.
    seed : int
        Seed of the choice of places at which light is judged.
    pointed : Pointed, optional
        Where a person says that lamps are; they come after those that are found, whose numbers stay.
    light : Environment, optional
        The light outside, of any brightness and tint, if it is known.

    Returns
    -------
    room : Room or None
        None where its light cannot be estimated.
    reason : str
        Why not; empty with a Room.

    Raises
    ------
    InputError
        For a place that points at no lamp.
    """
    sky = None if scene.measured is None else scene.measured.sky
    areas, visible = samples.vertex_areas(occluder), visible_fraction(transfer)
    frame = Frame.around(scene.vertices, scene.faces)
    eyes = frame.unit(within(scene))
    seen, below = seen_from(occluder, np.arange(len(captured)), eyes), below_ceiling(occluder, eyes)
    found = [
        lamp
        for lamp in lamps.find(occluder, captured, areas, visible, interreflection.bounce(captured))
        if areas[lamp.rows] @ seen[lamp.rows] > LEAST_SEEN * lamp.area
    ]
    known = None if light is None else WindowLight.of(light, occluder, transfer, np.where(seen, areas, 0.0))
    even = Evenness(occluder)
    normals = even.average_directions(occluder.normals, AVERAGING_ROUNDS)

    def light_of(lamp: lamps.Lamp) -> NDArray[np.float32]:
        return even.average(lamps.light_of(lamp, occluder, areas, normals), AVERAGING_ROUNDS)

    def judged(sample: int = 0) -> tuple[received.RoomIrradiance, strengths.Strengths | None]:
        usable = seen & below
        for lamp in found:
            usable[lamp.rows] = False
        rows = [lamp.rows for lamp in found]
        stacked = np.stack(lights) if lights else np.zeros((0, len(captured)), np.float32)
        surface = received.RoomSurface(normals, captured, areas, usable)
        through = None if known is None else known.direct
        places = received.places_of(occluder, surface, rows, stacked, sky, seed + sample, through)
        return places, strengths.solve(places, np.array([lamp.color for lamp in found]).reshape(-1, 3))

    def settled() -> strengths.Strengths | None:
        return strengths.averaged([(places, solved), *map(judged, range(1, strengths.SAMPLES))])

    lights = [light_of(lamp) for lamp in found]
    while True:  # until no further candidate is rejected
        places, solved = judged()
        if solved is None:
            break
        kept = _rows_of_lamps(found, lights, solved, interreflection, captured, areas)
        if len(kept) == len(found):
            break
        found, lights = [found[k] for k in kept], [lights[k] for k in kept]
    solved = settled()
    reason = "neither a lamp nor a window was found in it" if solved is None else _unlikely(solved)
    numbers: list[int] = []
    if pointed is not None:
        if reason:  # their numbers were never reported
            found, lights = [], []
        bounce = interreflection.bounce(captured)
        at = frame.unit(pointed.places)
        more, numbers = lamps_at(occluder, captured, areas, bounce, at, pointed.names, found)
        first, said = found, len(more)
        found, lights = [*found, *more], [*lights, *map(light_of, more)]
        while True:  # beside lamps that the user points at, the others are tested again
            places, solved = judged()
            if solved is None:
                break
            kept = _rows_of_lamps(found, lights, solved, interreflection, captured, areas)
            kept = sorted({*kept, *range(len(found) - said, len(found))})
            if len(kept) == len(found):
                break
            found, lights = [found[k] for k in kept], [lights[k] for k in kept]
        solved = settled()
        if solved is not None:
            found, lights, solved = _in_place(first, found, lights, solved)
        reason = "" if solved is not None else "the lamps that were pointed at light nothing of what was seen"
    if solved is None or reason:
        return None, reason
    environment = capture_light(sky, places.patches, solved.patches, known)
    outside, brightness = np.zeros_like(captured), 1.0
    if len(places.patches):
        outside, weight = direct_light(occluder, transfer, environment), np.where(seen, areas, 0.0)
        brightness = float(max(weight @ luminance(outside), 1e-6) / max(weight @ visible, 1e-12))
    emitters = list(zip(found, lights, solved.radiance, strict=False))
    lit = _lit(captured, interreflection, outside, areas, seen, emitters, occluder.faces)
    report = _report(frame, found, places, solved) | {"self_relight_db": lit.pop("self_relight_db")}
    report |= {"pointed": [number + 1 for number in numbers]} if numbers else {}
    return Room(**lit, environment=environment, brightness=brightness, report=report), ""


def _rows_of_lamps(
    found: list[lamps.Lamp],
    lights: list[NDArray[np.float32]],
    solved: strengths.Strengths,
    interreflection: Interreflection,
    captured: Radiance,
    areas: Floats,
) -> list[int]:
    """Which candidates are lamps: those that send more than they could reflect, with a strength that the room
    determines."""
    bounce, kept = interreflection.bounce(captured), []
    for k, lamp in enumerate(found):
        weight = areas[lamp.rows] / areas[lamp.rows].sum()
        around = weight @ luminance(bounce[lamp.rows])
        for other, light in enumerate(lights):
            if other != k:
                around += luminance(solved.radiance[other]) * float(weight @ light[lamp.rows])
        if luminance(solved.radiance[k]) > LEAST_EXCESS * around and solved.evidence[k] > LEAST_EVIDENCE:
            kept.append(k)
    return kept


def _in_place(
    first: list[lamps.Lamp],
    found: list[lamps.Lamp],
    lights: list[NDArray[np.float32]],
    solved: strengths.Strengths,
) -> tuple[list[lamps.Lamp], list[NDArray[np.float32]], strengths.Strengths]:
    """The lamps, with rejected ones of the first as dark ones, so all keep their numbers."""
    gone = [k for k, lamp in enumerate(first) if not any(lamp is other for other in found)]
    found, lights = list(found), list(lights)
    radiance, evidence, share = solved.radiance, solved.evidence, solved.share
    for k in gone:
        found.insert(k, first[k]._replace(rows=np.zeros(0, np.int64)))
        lights.insert(k, np.zeros_like(lights[0]))
        radiance, evidence, share = (
            np.insert(radiance, k, 0.0, axis=0),
            np.insert(evidence, k, 0.0),
            np.insert(share, k, 0.0),
        )
    return found, lights, solved._replace(radiance=radiance, evidence=evidence, share=share)


def _unlikely(solved: strengths.Strengths) -> str:
    """Why the Strengths are not reliable, or an empty text."""
    least = np.full(len(solved.evidence), LEAST_EVIDENCE)
    least[len(solved.radiance) :] = LEAST_OF_WINDOWS
    if (solved.evidence < least).all():
        return "its surfaces do not determine the brightness of its lamps and windows"
    if not ALBEDOS[0] < solved.albedo < ALBEDOS[1]:
        return f"its surfaces would have an albedo of {solved.albedo:.2f}"
    return ""


def _lit(
    captured: Radiance,
    interreflection: Interreflection,
    outside: Radiance,
    areas: Floats,
    seen: Mask,
    emitters: list[tuple[lamps.Lamp, NDArray[np.float32], NDArray[np.float64]]],
    faces: NDArray[np.integer],
) -> dict[str, Any]:
    """The arrays of a Room, and how near the model comes to the captured colours.

    outside: (V, 3) direct light through the windows. emitters: (Lamp, light (V,), radiance (3,)) each.
    """
    glow, lamp_light, sent = np.zeros_like(captured), np.zeros_like(captured), captured.copy()
    each = np.zeros((len(emitters), *captured.shape), np.float32)
    lamp_of = np.full(len(captured), -1, np.int16)
    for number, (lamp, light, radiance) in enumerate(emitters):
        each[number] = light[:, None] * radiance.astype(np.float32)
        lamp_light += each[number]
        lamp_of[lamp.rows] = number
        glow[lamp.rows] = np.maximum(radiance, captured[lamp.rows])
        sent[lamp.rows] = 0.0
    glowing: Mask = np.asarray(glow.any(axis=1))
    irradiance = outside + lamp_light + interreflection.bounce(sent)
    shares = np.where(seen & ~glowing, areas, 0.0)
    prior = prior_of(captured, irradiance, shares)
    albedo = albedo_of(captured, irradiance, prior)
    albedo[glowing] = prior.albedo
    by_lamps, _ = with_bounces(lamp_light, albedo, interreflection)
    if not outside.any():  # all light is that of lamps
        by_lamps = np.where(glowing[:, None], by_lamps, captured)
    modelled = by_lamps + with_bounces(outside, albedo, interreflection)[0]
    off = srgb_from_linear(np.clip(modelled, 0.0, 1.0)) - srgb_from_linear(np.clip(captured, 0.0, 1.0))
    judged = np.where(captured.max(axis=1) < received.SATURATED, shares, 0.0)
    error = float(judged @ np.square(off).mean(axis=1)) / max(float(judged.sum()), 1e-30)
    decibels = round(float(-10.0 * np.log10(max(error, 1e-10))), 2)
    level = float((judged @ captured).sum() / max(float((judged @ modelled).sum()), 1e-12))
    bright = glowing | (captured.max(axis=1) > lamps.PALE)  # lamps and their overexposed surroundings are not modelled
    trust = trust_in(np.where(bright[:, None], captured, level * modelled), captured, faces)
    arrays = {"albedo": albedo, "irradiance": captured / albedo, "by_lamps": by_lamps, "glow": glow, "prior": prior}
    arrays |= {"lamp_light": each, "lamp_of": lamp_of}
    return {**arrays, "trust": trust, "self_relight_db": decibels}


def _report(
    frame: Frame, found: list[lamps.Lamp], places: received.RoomIrradiance, solved: strengths.Strengths
) -> dict[str, Any]:
    """Dict for the report: lamps with place, size, strength and evidence; windows; how the room was explained.

    assumed_albedo: the median albedo that their total brightness was derived from; the room does not determine it.
    """
    lamp_facts = [
        {
            "place": np.round(lamp.place * frame.diagonal + frame.center, 3).tolist(),
            "area": round(lamp.area * frame.diagonal**2, 4),
            "radiance": np.round(solved.radiance[k], 2).tolist(),
            "evidence": round(float(solved.evidence[k]), 3),
            "share_of_light": round(float(solved.share[k]), 3),
        }
        for k, lamp in enumerate(found)
    ]
    windows = None
    if len(places.patches):
        windows = {
            "evidence": round(float(solved.evidence[-1]), 3),
            "share_of_light": round(float(solved.share[-1]) + solved.share_known, 3),
            "excess": np.round(solved.patches.mean(axis=0), 3).tolist(),
            "patches": len(solved.patches),
        }
    gains = {"agreement_gain": round(solved.gain, 3), "median_albedo": round(solved.albedo, 3)}
    gains["assumed_albedo"] = strengths.USUAL_ALBEDO
    return {"lamps": lamp_facts, "windows": windows, **gains}
