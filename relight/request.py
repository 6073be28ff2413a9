"""A complete relight request as a frozen value, with a field for each option of the command.

It holds every default and checks every field before any work. Imports nothing heavy.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from splat2mesh.base.choices import DEFAULT_FPS, MOST_STEPS, check_choice, several
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import vector
from splat2mesh.options import ConvertOptions, TilingOptions

from .light import CAPTURED, SKIES
from .light.daylight import DaylightRequest, day_times
from .options import LightingOptions
from .output.kinds import (
    BAKED,
    CITY_FILES,
    COLOR_SPACES,
    DEFAULT_KINDS,
    FILES,
    HARMONICS,
    OUTPUTS,
    WITHOUT_LIGHT,
    check_parts,
    kinds_with,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from splat2mesh.scene.foreign import AnyScene

    from .insert.probe import ProbeGrid
    from .light.environment import Environment

AnyLight: TypeAlias = "Environment | DaylightRequest | str | os.PathLike[str]"
"""An Environment, the sky of a date, a file, or the name of a built-in one."""

AnyAlbedo: TypeAlias = "str | os.PathLike[str] | NDArray[np.floating]"
"""One of "estimated", "captured" and "white"; a .npy file; or (V, 3) linear."""

MOST_EXPOSURE_EV = 64.0
"""Largest exposure in stops: far beyond any light, and 2^64 still fits in the float32 of the files."""

AUTO = "auto"
"""Lets the request choose the light."""

CACHING = ("keep", "read", "none")
"""Write and read the cache in the scene's folder, only read it, or neither."""

ALBEDOS = "estimated", "captured", "white"

CHOICES = {
    "formats": tuple(dict.fromkeys([*FILES, *CITY_FILES])),
    "baked": BAKED,
    "sky": SKIES,
    "color_space": COLOR_SPACES,
    "harmonics": HARMONICS,
    "caching": CACHING,
}
"""Field -> the words that it takes, one or several."""


@dataclass(frozen=True, eq=False)
class RelightRequest:
    """A scene, its new light, and the results to write.

    Parameters
    ----------
    scene : scene, mesh or path
        A Scene, a scene folder, a mesh file or mesh object, a splat (which is meshed first), or a city in tiles.
    env : Environment, path or name, or several of them
        The light: an `.exr` or `.hdr` file, a folder of them, one of studio, overcast, sunset, noon, or "captured",
        the light of the capture; "auto" is captured if something is added or that light changes, otherwise studio.
        Several light the scene one after another.
    sun : str
        Replaces `env` by the clear sky of a date and time with its zone, such as "2026-06-21T19:30+02:00".
    at : str
        Latitude and longitude for `sun`, such as "48.85,2.35".
    north_deg : float
        Turns north about +y from -z, counter-clockwise from above.
    day : str
        Times of that day, such as "05:00-21:30/15min": a folder for each, at one exposure, and a film of the pictures.
    lighting : LightingOptions
        How accurately the light is computed, and what happens to captured lamps.
    angles_deg : sequence of float
        Turns of the light about +y, counter-clockwise from above; each fills a folder.
    inserted : sequence
        Added objects: texts such as "statue.glb at=1.5,0,-.6 turn=30", files of a layout, or AskedInsert.
    albedo : optional
        Colour of the surface: "estimated" (the default for scenes from a splat), "captured" (the default for other
        meshes), "white", a .npy file, or (V, 3) linear float.
    capture_env : optional
        The light of the capture, if you have it.
    white_at : sequence of (3,), optional
        A position, in the frame of the splat, whose surface is white or grey: it corrects the colour of that light.
    exposure_ev : float, optional
        Show radiance times 2^EV. Default: the exposure of the capture.
    formats : sequence of str, optional
        Words of `output.kinds.FILES`, for a city of `CITY_FILES`. Default: glb, png and, for a scene from a splat,
        splat; for a city glb and splat.
    baked : sequence of {"texture", "transfer"}
        Textures for low-poly meshes.
    texture_size : int, optional
        Side of the textures in texels. Default: as fine as the splat.
    sheet : bool
        Write `sheet.png`, which shows the capture, the albedo and all lights.
    sky : {"new", "keep", "drop"}
        Far background of a relit splat.
    only, keep : sequence of str, path or array
        Parts that alone take the new light, or alone keep the captured one, as of `splats.part_spec`. shadow_of_parts :
        what takes the new light also casts its shadow on the rest, and its captured shadow is taken away.
    parts : sequence of str or dict
        Parts in lights of their own, as of `splats.lit_part`: "part1 env=sunset exposure=1".
    probe_at : sequence of (3,)
        Positions of the probes, in the frame of the splat. Default: one at the position of the capture.
    probes : str
        A grid of probes for engines: counts along x, y, z such as "4x2x4", or the largest distance between two, in the
        box about `probe_at`, or about the scene without its far background.
    cameras : path, optional
        Cameras of the passes, as `splat2mesh` takes those of a capture. Default: the camera of the preview.
    color_space : {"srgb", "acescg"}
        Colour space of the passes, linear.
    live_mesh : bool
        Also write `live.glb`, a mesh whose light turns in shaders.
    harmonics : {"zero", "keep"}
        View-dependent colour of an albedo splat.
    splat : path, optional
        The splat of the scene. Default: the file that the scene names.
    animated : bool
        Light every frame of an animated .glb, or of animated inserted objects. fps : frames per second.
    caching : {"keep", "read", "none"}
        Whether transfers, albedo and texels are cached in the scene's folder. clear_cache : empty it first.
    meshing : ConvertOptions
        How to mesh a splat that has no scene folder yet.
    tiling : TilingOptions, optional
        How to process a city in tiles.
    output : path, optional
        Folder to write; with several lights, the parent of their folders.
    overwrite : bool
        Replace results of other settings.
    quick : bool
        Stop at the first look at a splat file: a picture and a relit splat within seconds, without a mesh.
    sequence : bool
        The scene is a folder of numbered splats, frames of one capture in motion. With the formats splat and png also a
        film.

    Raises
    ------
    InputError
        For any other value, and for fields that exclude each other; the message names the field.
    """

    scene: "AnyScene"
    env: "AnyLight | Sequence[AnyLight]" = AUTO
    lighting: LightingOptions = field(default_factory=LightingOptions)
    angles_deg: Sequence[float] = (0.0,)
    sun: str = ""
    at: str = ""
    north_deg: float = 0.0
    day: str = ""
    inserted: Sequence[Any] = ()
    albedo: "AnyAlbedo | None" = None
    capture_env: "AnyLight | None" = None
    white_at: Any = None
    exposure_ev: float | None = None
    formats: Sequence[str] | None = None
    baked: Sequence[str] = ()
    texture_size: int | None = None
    sheet: bool = False
    sky: str = "new"
    only: Sequence[Any] = ()
    keep: Sequence[Any] = ()
    shadow_of_parts: bool = False
    parts: Sequence[Any] = ()
    probe_at: Sequence[Any] = ()
    probes: str = ""
    cameras: str | os.PathLike[str] | None = None
    color_space: str = "srgb"
    live_mesh: bool = False
    harmonics: str = "zero"
    splat: str | os.PathLike[str] | None = None
    animated: bool = False
    fps: float = DEFAULT_FPS
    caching: str = "keep"
    clear_cache: bool = False
    meshing: ConvertOptions = field(default_factory=ConvertOptions)
    tiling: TilingOptions | None = None
    output: str | os.PathLike[str] | None = None
    overwrite: bool = False
    quick: bool = False
    sequence: bool = False

    def __post_init__(self) -> None:
        self._bring_into_form()
        self._check_sun()
        if self.env == AUTO:
            changes = self.lighting.changes_captured_light or bool(self.inserted or self.parts) or self.needs_no_light
            self._set("env", CAPTURED if changes else "studio")
        self._set("probe_at", tuple(vector("probe_at", each) for each in self.probe_at))
        if self.white_at is not None:
            self._set("white_at", vector("white_at", self.white_at))
        if self.capture_env is not None and "captured_light" in self.lighting.said:
            raise InputError("`captured_light`: it is a known light as `capture_env` is; give one of them")
        self._check_outputs()
        check_parts(self)
        self._check_angles()
        if self.exposure_ev is not None and not abs(self.exposure_ev) <= MOST_EXPOSURE_EV:
            limit = f"{MOST_EXPOSURE_EV:g}"
            raise InputError(f"`exposure_ev` {self.exposure_ev}: expected stops from -{limit} to {limit}")
        if self.clear_cache and self.caching != "keep":
            raise InputError("`clear_cache`: without a cache there is nothing to clear")

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _bring_into_form(self) -> None:
        """Make tuples of lists, one light of a list with one, and the words of CHOICES of any like them."""
        for name in ("inserted", "only", "keep", "parts"):
            value = getattr(self, name)
            self._set(name, tuple(value) if isinstance(value, (list, tuple)) else (value,))
        for name in ("angles_deg", "probe_at"):
            self._set(name, tuple(getattr(self, name)))
        for name, choices in CHOICES.items():
            value = getattr(self, name)
            if name not in ("formats", "baked"):
                self._set(name, check_choice(name, value, choices))
            elif value is not None:
                self._set(name, several(name, (value,) if isinstance(value, str) else tuple(value), choices))
        if isinstance(self.env, (list, tuple)):
            self._set("env", self.env[0] if len(self.env) == 1 else tuple(self.env) or AUTO)

    def _check_outputs(self) -> None:
        """Raise InputError for options of outputs that are not requested, and for outputs that lack what they need."""
        formats = DEFAULT_KINDS if self.formats is None else self.formats
        for each in fields(self):
            kinds, value = kinds_with(each.name), getattr(self, each.name)
            if kinds and value != each.default and not {*kinds} & {*formats}:
                raise InputError(f"`{each.name}`: it belongs to the format {' or '.join(kinds)}; give that too")
        for word in formats:
            needs = OUTPUTS[word].needs if word in OUTPUTS else None
            if needs is not None and not getattr(self, needs[0]):
                raise InputError(f"`formats` {word}: {needs[1]}")
        if self.probes and len(self.probe_at) == 1:
            raise InputError("`probes`: a box has two corners; give another `probe_at`, or none")
        _ = self.probe_grid  # or an InputError

    def _check_angles(self) -> None:
        """Raise InputError for angles, or times of a day, that a light cannot have."""
        _ = self.times  # or an InputError
        if not 1 <= len(self.angles_deg) <= MOST_STEPS:
            raise InputError(f"`angles_deg`: {len(self.angles_deg)} angles; expected 1 to {MOST_STEPS}")
        if CAPTURED in self.envs and any(angle % 360.0 for angle in self.angles_deg):
            raise InputError("`angles_deg`: the light of the capture cannot be turned; give another `env`")
        if self.animated and len(self.angles_deg) > 1:
            raise InputError("`angles_deg`: an animation has one angle")

    def _check_sun(self) -> None:
        """Make the sky of a date the light. Raises InputError for a date without a place, or a place without a date."""
        if not self.sun:
            for name in ("at", "north_deg", "day"):
                if getattr(self, name):
                    raise InputError(f"`{name}`: it belongs to the `sun` of a date; give that too")
            return
        if not isinstance(self.env, DaylightRequest) and self.env != AUTO:
            raise InputError("`sun`: it replaces `env`; give one of them")
        if not self.at:
            raise InputError("`sun`: give the latitude and longitude too, as `at`, such as 48.85,2.35")
        asked = DaylightRequest.parse(self.sun, self.at, self.north_deg)
        if self.day and self.animated:
            raise InputError("`day`: an animation has one light")
        self._set("env", self.env if isinstance(self.env, DaylightRequest) else asked)

    @property
    def envs(self) -> tuple[AnyLight, ...]:
        """What `env` names, in order: one light or several, any of them a folder."""
        return tuple(self.env) if isinstance(self.env, (list, tuple)) else (cast("AnyLight", self.env),)

    @property
    def light(self) -> AnyLight:
        """The light. Raises InputError for several."""
        if len(self.envs) > 1:
            raise InputError(f"`env` {self.envs[1]}: one light is expected here; give {self.envs[0]} alone")
        return self.envs[0]

    @property
    def needs_no_light(self) -> bool:
        """Whether the request needs no light."""
        other = self.baked or self.sheet or self.live_mesh
        return bool(self.formats) and not other and {*(self.formats or ())} <= {*WITHOUT_LIGHT}

    @property
    def times(self) -> "list[DaylightRequest]":
        """The skies of `day`, in order; none without."""
        if not self.day:
            return []
        asked = DaylightRequest.parse(self.sun, self.at, self.north_deg)
        return [asked.at_time(time) for time in day_times(self.day, asked.time)]

    @property
    def probe_grid(self) -> "ProbeGrid | None":
        """The grid of `probes`; None without. Raises InputError for other words."""
        from .insert.probe import ProbeGrid

        return ProbeGrid.parse(self.probes) if self.probes else None

    @classmethod
    def of(
        cls,
        scene: "AnyScene | RelightRequest",
        env: AnyLight = AUTO,
        lighting: LightingOptions | str | None = None,
        **changes: Any,
    ) -> "RelightRequest":
        """Return a request of loose arguments.

        lighting: LightingOptions or the name of a method. changes: fields of the request and of its LightingOptions,
        such as tolerance=0.02, side by side. A request is returned with its fields changed.
        """
        own = {each.name for each in fields(cls)}
        finer = {name: changes.pop(name) for name in list(changes) if name not in own}
        if isinstance(scene, RelightRequest):
            lighting = scene.lighting if lighting is None else lighting
            return replace(scene, lighting=LightingOptions.of(lighting, **finer), **changes)
        return cls(scene, env, LightingOptions.of(lighting, **finer), **changes)

    def under(self, env: AnyLight) -> "RelightRequest":
        """Return the same request under another light."""
        return replace(self, env=env, sun="", at="", north_deg=0.0, day="")
