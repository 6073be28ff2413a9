"""The light of a closed room as it was captured: its lamps, its windows, the albedo of its surfaces."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Mask, Radiance
from splat2mesh.scene.color import luminance, srgb_from_linear
from splat2mesh.scene.measured import CapturedSky
from splat2mesh.scene.scene import Scene

from ..albedo import samples
from ..albedo.division import Prior, albedo_of, prior_of
from ..light.environment import Environment
from ..transfer.bounces import visible_fraction, with_bounces
from ..transfer.occluder import Frame, Occluder
from ..transfer.transport import Transport
from . import lamps, received, strengths
from .evenness import Evenness
from .interior import within
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
    scene: Scene,  # captured from within
    occluder: Occluder,
    transport: Transport,  # of the white scene
    seed: int = 0,  # of the places at which light is judged
    pointed: Pointed | None = None,
    light: Environment | None = None,  # outside, of any brightness and tint, if it is known
) -> tuple[Room | None, str]:
    """Separate lamps, windows and albedo of a closed room from its captured colours: the Room, or None and the reason.

    Raises InputError for a place that points at no lamp.
    """
    frame = Frame.around(scene.vertices, scene.faces)
    search = _Search(_Shown.of(scene, occluder, frame, transport, light), seed)
    search.add(search.shown.candidates())
    solved = search.settled()
    reason = "neither a lamp nor a window was found in it" if solved is None else _unlikely(solved)
    numbers: list[int] = []
    if pointed is not None:
        if reason:  # their numbers were never reported
            search = _Search(search.shown, seed)
        solved, numbers = search.with_pointed(frame.unit(pointed.places), pointed.names)
        reason = "" if solved is not None else "the lamps that were pointed at light nothing of what was seen"
    if solved is None or reason:
        return None, reason
    return _room(search, solved, frame, numbers), ""


class _Shown(NamedTuple):
    """What a capture shows of a room of V vertices, and how light travels in it.

    seen: (V,) mask of what was visible to it; below: of what does not lie above the ceiling. even: for light.
    normals: averaged along the surface. bounce: (V, 3) radiance of white under the captured colours around it.
    known: the light outside where that is given.
    """

    occluder: Occluder
    captured: NDArray[np.float32]
    areas: NDArray[np.float64]
    transport: Transport
    sky: CapturedSky | None
    seen: Mask
    below: Mask
    even: Evenness
    normals: NDArray[np.float32]
    bounce: NDArray[np.float32]
    known: WindowLight | None

    @classmethod
    def of(
        cls, scene: Scene, occluder: Occluder, frame: Frame, transport: Transport, light: Environment | None
    ) -> "_Shown":
        captured, areas, eyes = scene.colors_linear, samples.vertex_areas(occluder), frame.unit(within(scene))
        seen, even = seen_from(occluder, np.arange(len(captured)), eyes), Evenness(occluder)
        weights = np.where(seen, areas, 0.0)
        return cls(
            occluder=occluder,
            captured=captured,
            areas=areas,
            transport=transport,
            sky=None if scene.measured is None else scene.measured.sky,
            seen=seen,
            below=below_ceiling(occluder, eyes),
            even=even,
            normals=even.average_directions(occluder.normals, AVERAGING_ROUNDS),
            bounce=transport.interreflection.bounce(captured),
            known=None if light is None else WindowLight.of(light, occluder, transport.transfer, weights),
        )

    def candidates(self) -> list[lamps.Lamp]:
        """Lamps by their colour, of which enough was seen."""
        visible = visible_fraction(self.transport.transfer)
        found = lamps.find(self.occluder, self.captured, self.areas, visible, self.bounce)
        return [lamp for lamp in found if self.areas[lamp.rows] @ self.seen[lamp.rows] > LEAST_SEEN * lamp.area]

    def light_of(self, lamp: lamps.Lamp) -> NDArray[np.float32]:
        light = lamps.light_of(lamp, self.occluder, self.areas, self.normals)
        return self.even.average(light, AVERAGING_ROUNDS)


class _Search:
    """The candidates for lamps of a room, of which those that turn out to be none are dropped.

    found, lights: the Lamps that are left, and the light (V,) of each at radiance 1. places: where light was judged.
    """

    places: received.RoomIrradiance

    def __init__(self, shown: _Shown, seed: int) -> None:
        self.shown, self._seed = shown, seed
        self.found: list[lamps.Lamp] = []
        self.lights: list[NDArray[np.float32]] = []

    def add(self, more: list[lamps.Lamp]) -> None:
        self.found, self.lights = [*self.found, *more], [*self.lights, *map(self.shown.light_of, more)]

    def settled(self, certain: int = 0) -> strengths.Strengths | None:
        """Drop candidates until none is rejected; the Strengths of the rest. certain: so many of the last are lamps."""
        while True:
            self.places, solved = self._judged()
            if solved is None:
                break
            kept = sorted({*self._lamps(solved), *range(len(self.found) - certain, len(self.found))})
            if len(kept) == len(self.found):
                break
            self.found, self.lights = [self.found[k] for k in kept], [self.lights[k] for k in kept]
        return strengths.averaged([(self.places, solved), *map(self._judged, range(1, strengths.SAMPLES))])

    def with_pointed(
        self, places: NDArray[np.floating], names: list[str]
    ) -> tuple[strengths.Strengths | None, list[int]]:
        """The Strengths with the lamps that places (P, 3), unit frame, point at, and the number of each of these.

        Beside them the others are tested again; those that are rejected stay as dark ones, so all keep their numbers.
        """
        shown, first = self.shown, self.found
        more, numbers = lamps_at(shown.occluder, shown.captured, shown.areas, shown.bounce, places, names, first)
        self.add(more)
        solved = self.settled(len(more))
        if solved is not None:
            self.found, self.lights, solved = _in_place(first, self.found, self.lights, solved)
        return solved, numbers

    def _judged(self, sample: int = 0) -> tuple[received.RoomIrradiance, strengths.Strengths | None]:
        shown = self.shown
        usable, sent = shown.seen & shown.below, shown.captured.copy()
        for lamp in self.found:
            usable[lamp.rows], sent[lamp.rows] = False, 0.0
        bounce = shown.transport.interreflection.bounce(sent)
        stacked = np.stack(self.lights) if self.lights else np.zeros((0, len(shown.captured)), np.float32)
        surface = received.RoomSurface(shown.normals, shown.captured, shown.areas, usable)
        through = None if shown.known is None else shown.known.direct
        places = received.places_of(shown.occluder, surface, bounce, stacked, shown.sky, self._seed + sample, through)
        return places, strengths.solve(places, np.array([lamp.color for lamp in self.found]).reshape(-1, 3))

    def _lamps(self, solved: strengths.Strengths) -> list[int]:
        """Which candidates are lamps: those that send more than they could reflect, with a strength that the room
        determines."""
        kept, areas = [], self.shown.areas
        for k, lamp in enumerate(self.found):
            weight = areas[lamp.rows] / areas[lamp.rows].sum()
            around = weight @ luminance(self.shown.bounce[lamp.rows])
            for other, light in enumerate(self.lights):
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


def _room(search: _Search, solved: strengths.Strengths, frame: Frame, numbers: list[int]) -> Room:
    """The Room of what was found. numbers: of the lamps that were pointed at."""
    shown, interreflection = search.shown, search.shown.transport.interreflection
    occluder, captured, places = shown.occluder, shown.captured, search.places
    shares = np.where(shown.seen, shown.areas, 0.0)
    environment = capture_light(shown.sky, places.patches, solved.patches, shown.known)
    outside, brightness = np.zeros_like(captured), 1.0
    if len(places.patches):
        outside = direct_light(occluder, shown.transport.transfer, environment)
        visible = visible_fraction(shown.transport.transfer)
        brightness = float(max(shares @ luminance(outside), 1e-6) / max(shares @ visible, 1e-12))
    glow, lamp_light, sent = np.zeros_like(captured), np.zeros_like(captured), captured.copy()
    each = np.zeros((len(search.found), *captured.shape), np.float32)
    lamp_of = np.full(len(captured), -1, np.int16)
    for number, (lamp, light) in enumerate(zip(search.found, search.lights, strict=True)):
        radiance = solved.radiance[number]
        each[number] = light[:, None] * radiance.astype(np.float32)
        lamp_light += each[number]
        lamp_of[lamp.rows] = number
        glow[lamp.rows] = np.maximum(radiance, captured[lamp.rows])
        sent[lamp.rows] = 0.0
    glowing: Mask = np.asarray(glow.any(axis=1))
    irradiance = outside + lamp_light + interreflection.bounce(sent)
    shares = np.where(glowing, 0.0, shares)
    prior = prior_of(captured, irradiance, shares)
    albedo = albedo_of(captured, irradiance, prior)
    albedo[glowing] = prior.albedo
    by_lamps, _ = with_bounces(lamp_light, albedo, interreflection)
    if not outside.any():  # all light is that of lamps
        by_lamps = np.where(glowing[:, None], by_lamps, captured)
    modelled = by_lamps + with_bounces(outside, albedo, interreflection)[0]
    judged = np.where(captured.max(axis=1) < received.SATURATED, shares, 0.0)
    level = float((judged @ captured).sum() / max(float((judged @ modelled).sum()), 1e-12))
    bright = glowing | (captured.max(axis=1) > lamps.PALE)  # lamps and their overexposed surroundings are not modelled
    trust = trust_in(np.where(bright[:, None], captured, level * modelled), captured, occluder.faces)
    report = _report(frame, search.found, places, solved) | {"self_relight_db": _decibels(captured, modelled, judged)}
    report |= {"pointed": [number + 1 for number in numbers]} if numbers else {}
    return Room(
        albedo=albedo,
        irradiance=captured / albedo,
        by_lamps=by_lamps,
        glow=glow,
        lamp_light=each,
        lamp_of=lamp_of,
        environment=environment,
        brightness=brightness,
        prior=prior,
        trust=trust,
        report=report,
    )


def _decibels(captured: Radiance, modelled: Radiance, weights: Floats) -> float:
    """How near the model comes to the captured colours, PSNR of the pictures."""
    off = srgb_from_linear(np.clip(modelled, 0.0, 1.0)) - srgb_from_linear(np.clip(captured, 0.0, 1.0))
    error = float(weights @ np.square(off).mean(axis=1)) / max(float(weights.sum()), 1e-30)
    return round(float(-10.0 * np.log10(max(error, 1e-10))), 2)


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
