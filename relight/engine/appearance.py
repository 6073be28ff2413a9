"""The colours of a scene: as captured, from a file, or with the captured light removed."""

import os
import warnings
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrayfiles import load_array
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.measured import CapturedSky
from splat2mesh.scene.scene import Scene

from ..albedo import CaptureEvidence, Prior, estimate, with_known_light
from ..albedo.captured import BANDS, BOUNCE_RAYS, RAYS
from ..albedo.division import DARKEST
from ..albedo.offered import offer_lights
from ..albedo.seen import looks_from, standing
from ..albedo.skylight import LEAST_VISIBLE, visible_part
from ..light.environment import Environment
from ..options import lamp_name
from ..rooms.interior import closed_part, room_notice
from ..rooms.keeping import as_arrays, room_from
from ..rooms.room import Pointed, room_of
from ..transfer.bounces import visible_fraction
from ..transfer.settings import Settings
from ..transfer.store import array_key
from .relighter import Relighter

if TYPE_CHECKING:
    from ..albedo.said import Said
    from ..rooms.room import Room

CHOICES = ("estimated", "captured", "white")

WAY = 26
"""Version of the estimate of light and albedo. It increases when the numbers change, and invalidates cached
estimates."""

CAPTURE = Settings("raytraced", BANDS, RAYS, bounce_rays=BOUNCE_RAYS)
"""Transfer and bounces for the estimate of the captured light. In a place they are those that most lights need later,
and the cache then holds them. Objects have the same scores by 16 bounce rays."""


class Place(Enum):
    """What a capture is, for new light on it."""

    OPEN = "an object or an open place, or a room that is lit from above by its captured colours"
    ROOM = "a closed room whose lamps and windows are known"
    SHUT = "a closed room whose lamps are known, without a window"
    UNKNOWN = "a closed room whose light is unknown"


class Appearance(NamedTuple):
    """The appearance of surfaces. albedo: (V, 3) float32 linear, None for white. captured: (V, 3) float32 linear
    colours.

    irradiance: (V, 3) float32, the captured light at every vertex, in the unit of `captured`; without an
    estimate, the captured colour over the albedo. prior: of `albedo.albedo_of`, for other colours of the scene, or
    None. capture: dict for the report, None without an estimate. place: what the capture is. room: the Room of a closed
    room whose lamps and windows were separated, or None. environment: the estimated captured light, in the unit of
    `captured` and the frame of the scene, or None."""

    albedo: NDArray[np.float32] | None
    captured: NDArray[np.float32]
    irradiance: NDArray[np.float32]
    prior: "Prior | None" = None
    capture: dict[str, Any] | None = None
    place: Place = Place.OPEN
    room: "Room | None" = None
    environment: "Environment | None" = None

    @property
    def as_captured(self) -> bool:
        """Whether all colours stay as captured, since no environment is known to enter; its effect is assumed."""
        return self.place in (Place.SHUT, Place.UNKNOWN)

    def received(self, radiance: NDArray[np.float32], exposure: float = 1.0) -> NDArray[np.float32]:
        """(V, 3) float32 irradiance of vertices with exit radiance (V, 3): the radiance over the albedo.

        Where splats and textures stay as captured, it is the irradiance that this exposure shows unchanged.
        """
        if self.as_captured:
            return self.irradiance / np.float32(exposure)
        if self.albedo is not None:
            radiance = np.asarray(radiance / np.maximum(self.albedo, np.float32(DARKEST)), np.float32)
        return radiance


def appearance_of(
    choice: "str | os.PathLike[str] | NDArray[np.floating]",
    capture_env: "Environment | None",
    relighter: "Relighter",
) -> Appearance:
    """Return the Appearance for a choice of `albedo`.

    choice: one of CHOICES, or linear albedo (V, 3), as an array or a .npy file. capture_env: the known Environment of
    the capture, or None. Where the light
    cannot be separated, the captured colours serve as albedo, with a DataWarning.
    Raises InputError for an albedo that does not fit.
    """
    captured = relighter.scene.colors_linear
    if isinstance(choice, np.ndarray):
        own, choice = choice, "an array"
    said = (*(("capture_env",) if capture_env is not None else ()), *relighter.options.said)
    if said and choice != "estimated":
        raise InputError(f"`{said[0]}`: it needs an estimated albedo, and the albedo is {choice}")
    if choice == "an array":
        return _given(_checked(own, choice, len(captured)), captured)
    if choice == "captured":
        return _given(captured, captured)
    if choice == "white":
        return _given(None, captured)
    if choice != "estimated":
        return _given(_read(choice, len(captured)), captured)
    return _without_light(captured, capture_env, relighter)


def _given(albedo: NDArray[np.float32] | None, captured: NDArray[np.float32]) -> Appearance:
    found = Appearance(albedo, captured, captured)
    return found._replace(irradiance=found.received(captured))


def _without_light(
    captured: NDArray[np.float32],
    capture_env: "Environment | None",
    relighter: "Relighter",
) -> Appearance:
    cache, capture_env = relighter.cache, _known(capture_env, relighter)
    key = _key(captured, capture_env, relighter)
    kept = cache.restored(lambda arrays: _checked_estimate(arrays, captured.shape), "albedo", *key)
    if kept is None:
        kept = _of_objects(captured, capture_env, relighter)
        cache.put("albedo", *key, **kept)
    room, prior = room_from(kept), Prior(**{name: kept[f"prior_{name}"] for name in Prior._fields})
    _warn_of(kept)
    described = _described(kept, capture_env, room)
    if room is not None:
        place, sky = Place.ROOM, room.environment
    else:
        place = Place.UNKNOWN if kept["closed"] else Place.OPEN
        sky = Environment(kept["environment"], "captured", float(kept["light_turn"]))
    return Appearance(kept["albedo"], captured, kept["irradiance"], prior, described, place, room, sky)


def _warn_of(kept: dict[str, Any]) -> None:
    """Warn of an estimate that leaves something as captured."""
    if kept["closed"]:
        warnings.warn(str(kept["reason"]), DataWarning, stacklevel=4)
    elif not kept["separable"]:
        message = f"the light of the capture could not be separated from the colours of the scene: {kept['reason']}"
        warnings.warn(f"{message}; the captured colours serve as albedo", DataWarning, stacklevel=4)


def _described(kept: dict[str, Any], capture_env: "Environment | None", room: "Room | None") -> dict[str, Any]:
    """An estimate in the report."""
    found = {name: kept[name].tolist() for name in _DESCRIBED}
    estimated = "estimated, with the captured sky" if kept["under_sky"] else "estimated"
    found["light"] = estimated if capture_env is None else capture_env.name
    found["left_as_captured"] = bool(kept["closed"]) and room is None
    if kept["closed"]:
        found["room"] = None if room is None else room.report
    return found | {name: round(float(kept[name]), 3) for name in _CHECKED if name in kept}


def _known(capture_env: "Environment | None", relighter: "Relighter") -> "Environment | None":
    """The known light of the capture: the given one, or else that of the options or chosen in the scene's folder."""
    return relighter.said.light if capture_env is None else capture_env


def _pointed(relighter: "Relighter") -> "Pointed | None":
    """Positions of captured lamps from the options, or None."""
    places = relighter.options.pointed_at
    if not places:
        return None
    matrix = np.asarray(relighter.scene.scene_from_splat, np.float64)
    return Pointed(np.asarray(places) @ matrix[:3, :3].T + matrix[:3, 3], [lamp_name(each) for each in places])


def _checked_estimate(kept: dict[str, Any], shape: tuple[int, ...]) -> dict[str, Any]:
    """The estimate in cached arrays. Raises KeyError or ValueError where something is missing or does not fit."""
    names = ("separable", "reason", "under_sky", "closed", *_DESCRIBED)
    for name in (*names, *(f"prior_{name}" for name in Prior._fields)):
        kept[name]  # or a KeyError
    if "room_environment" not in kept and kept["light_turn"].shape:
        raise ValueError("its light has no angle")
    if "room_environment" not in kept and kept["environment"].shape[2:] != (3,):
        raise ValueError("its light is no picture")
    for name in ("albedo", "irradiance"):
        if kept[name].shape != shape or kept[name].dtype.kind != "f" or not np.isfinite(kept[name]).all():
            raise ValueError(f"its {name} does not fit the scene")
    return kept


def _key(
    captured: NDArray[np.float32],
    capture_env: "Environment | None",
    relighter: "Relighter",
) -> tuple[str, int]:
    """The cache key of an estimate."""
    sky = sky_of(relighter.scene)
    parts = [] if sky is None else [sky.radiance, sky.bound, sky.clipped]
    parts += [standing(relighter.scene), np.array(WAY)]
    parts += [np.array(relighter.options.pointed_at)] if relighter.options.pointed_at else []
    parts += relighter.said.key
    if capture_env is not None and capture_env.rotation_deg:
        parts.append(np.array(capture_env.rotation_deg))
    if capture_env is not None and capture_env.exposed:
        parts.append(np.array("exposed"))
    known = array_key(captured, None if capture_env is None else capture_env.radiance, *parts)
    return known + relighter.leaves + "shown" * relighter.precomputed.partly, relighter.seed


def bounced_light(relighter: "Relighter") -> NDArray[np.float32]:
    """(V, 3) float32 captured light that surfaces of a scene bounced to each other; 0 in a layout of several splats."""
    scene = relighter.scene
    if len(scene.source.get("objects") or ()) > 1:  # each was captured by itself
        return np.zeros_like(scene.colors_linear)
    known = relighter.transport(CAPTURE)
    return np.asarray(known.interreflection.bounce(scene.colors_linear), np.float32)


def albedo_kept(capture_env: "Environment | None", relighter: "Relighter") -> NDArray[np.float32] | None:
    """The albedo (V, 3) of a cached estimate, or None. A plan calls this, since it must not estimate anything."""
    captured, capture_env = relighter.scene.colors_linear, _known(capture_env, relighter)
    key = _key(captured, capture_env, relighter)
    kept = relighter.cache.restored(lambda arrays: _checked_estimate(arrays, captured.shape), "albedo", *key)
    return None if kept is None else kept["albedo"]


def sky_of(scene: Scene) -> CapturedSky | None:
    """The CapturedSky of a Scene where enough of the sky is visible, or None."""
    sky = None if scene.measured is None else scene.measured.sky
    return None if sky is None or visible_part(sky) < LEAST_VISIBLE else sky


def _of_objects(
    captured: NDArray[np.float32],
    capture_env: "Environment | None",
    relighter: "Relighter",
) -> dict[str, Any]:
    """Dict of arrays of the estimate. Each object of a layout is estimated by itself, under its own captured light.

    Entries that a layout has only once, such as those for the report, come from the object with the most vertices.
    """
    scene, objects = relighter.scene, relighter.scene.source.get("objects")
    if not objects or len(objects) == 1:
        return _estimated(captured, capture_env, relighter, relighter.said)
    ends = np.cumsum([0, *(len(chunk.vertices) for chunk in scene.chunks)])
    parts = []
    for first, last in (each["chunks"] for each in objects):
        alone = Relighter(Scene(scene.chunks[first:last]), seed=relighter.seed, stages=relighter.stages)
        parts.append(_estimated(captured[ends[first] : ends[last]], capture_env, alone, relighter.said))
    kept = dict(max(parts, key=lambda part: len(part["albedo"])))
    for name in ("albedo", "irradiance"):
        kept[name] = np.concatenate([part[name] for part in parts])
    failed = [each["name"] for each, part in zip(objects, parts, strict=True) if not part["separable"]]
    if failed:
        kept["separable"], kept["reason"] = np.array(False), np.array(f"of {', '.join(failed)}")
    return kept


def _estimated(
    captured: NDArray[np.float32],
    capture_env: "Environment | None",
    relighter: "Relighter",
    said: "Said",
) -> dict[str, Any]:
    known = relighter.transport(CAPTURE, alone=True)
    with relighter.stages.stage("albedo"):
        scene, sky = relighter.scene, sky_of(relighter.scene)
        looks = looks_from(scene, relighter.occluder)
        part, hopeless = closed_part(scene, relighter.occluder, visible_fraction(known.transfer)), ""
        if part is not None:
            room, hopeless = room_of(scene, relighter.occluder, known, relighter.seed, _pointed(relighter), capture_env)
            if room is not None:
                return as_arrays(room, room_notice(part, room.report))
            hopeless = room_notice(part, None, hopeless)
        if capture_env is None:
            evidence = CaptureEvidence(sky, looks, hopeless, said)
            found = estimate(relighter.occluder, captured, relighter.seed, transport=known, evidence=evidence)
            offer_lights(scene.path, found)
        else:
            part, evidence = None, CaptureEvidence(sky, looks, said=said)
            asked = relighter.occluder, captured, capture_env, relighter.seed
            found = with_known_light(*asked, transport=known, evidence=evidence)
    return {
        "under_sky": np.array(found.under_sky),
        "light_doubt_db": np.array(found.doubt_db),
        "closed": np.array(part is not None),
        "light_turn": np.array(found.environment.rotation_deg),
        "albedo": found.albedo,
        "irradiance": found.irradiance,
        "environment": found.environment.radiance,
        **{f"prior_{name}": np.asarray(value) for name, value in found.prior._asdict().items()},
        **{name: np.asarray(getattr(found, name)) for name in _DESCRIBED},
    }


_CHECKED = ("self_relight_db", "light_doubt_db")

_DESCRIBED = ("separable", "reason", "evidence", "direction", "concentration", "color", "brightness")


def _read(choice: str | os.PathLike[str], count: int) -> NDArray[np.float32]:
    """(V, 3) of a .npy file."""
    try:
        if not os.path.lexists(choice):
            raise InputError(f"`albedo` {choice}: expected {', '.join(CHOICES)} or a .npy file; no such file")
        albedo = load_array(choice)
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"`albedo` {choice}: not an array in .npy format ({error})") from None
    return _checked(albedo, choice, count)


def _checked(albedo: Any, choice: Any, count: int) -> NDArray[np.float32]:
    """(V, 3) of an array of albedo; `choice` names it in errors."""
    if not isinstance(albedo, np.ndarray) or albedo.shape != (count, 3) or albedo.dtype.kind not in "fiu":
        found = f"{albedo.dtype} of shape {albedo.shape}" if isinstance(albedo, np.ndarray) else "several arrays"
        raise InputError(f"`albedo` {choice}: expected numbers of shape ({count}, 3), found {found}")
    if not ((albedo >= 0.0) & (albedo <= 1.0)).all():
        low, high = albedo.min(), albedo.max()
        raise InputError(f"`albedo` {choice}: expected linear values from 0 to 1, found {low} to {high}")
    return albedo.astype(np.float32)
