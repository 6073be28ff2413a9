"""The requests for a session and for a turntable film, each as one frozen value, and the engine behind a session in the
form that its lamps, objects and parts need. Imports nothing heavy."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..options import LightingOptions
from ..output.kinds import PICTURE_SIZE

if TYPE_CHECKING:
    from splat2mesh.scene.foreign import AnyScene
    from splat2mesh.splats.splats import Splats

    from ..engine.by_hand import LightByHand
    from ..engine.light_mix import LightBeside, LightMix
    from ..engine.placed import Placed
    from ..insert.asked import AskedInsert
    from ..insert.inserts import InsertedLight, Inserts
    from ..lamps.asked import AskedLamp
    from ..light.environment import Environment
    from ..splats.grown_part import GrowingSurface
    from ..transfer.store import Cache
    from .splats import SplatSource


class LampSource(NamedTuple):
    """A scene whose lamps can be changed.

    mix: its LightMix, with the lamps at the start. level: returns its level. command: the command that relights with
    the saved lamps.
    """

    mix: "LightMix"
    level: Callable[[], float]
    command: str = ""

    def mixture(self, captured: float, placed: "Placed | None") -> "LightBeside":
        """The LightBeside of a factor on the captured light and of lamps, or None for no lamps."""
        return self.mix.beside(self.level(), captured, placed)


class ObjectsUnder(NamedTuple):
    """The light on objects. environment: the argument of `light_of`, or None. angle_deg: its rotation. env_scale,
    captured: factors on it and on the captured light. lamps: added ones. level: units of the picture per unit of the
    radiance. radiance, received: (V, 3) of the scene without the objects, exit radiance and irradiance over pi."""

    environment: Any
    angle_deg: float
    env_scale: float
    captured: float
    lamps: "Sequence[AskedLamp]"
    level: float
    radiance: NDArray[np.float32]
    received: NDArray[np.float32]


class ObjectSource(NamedTuple):
    """A scene whose objects can be moved.

    inserts: the objects at the start. received: returns the irradiance over pi (V, 3) of the scene for the radiance of
    an environment and its exposure. exact: the InsertedLight of objects under a light, with all rays; calls its
    last argument often, which may raise to end it.
    """

    inserts: "Inserts"
    received: Callable[[NDArray[np.float32], float], NDArray[np.floating]]
    exact: "Callable[[Sequence[AskedInsert], ObjectsUnder, Callable[..., None]], InsertedLight]"


class PartSource(NamedTuple):
    """A scene whose capture can be parted. surface: returns the GrowingSurface, which takes long. splats: every row of
    the capture. folder: of the scene, where parts are kept."""

    surface: "Callable[[], GrowingSurface]"
    splats: "Splats"
    folder: Path


@dataclass(frozen=True, eq=False)
class SessionRequest:
    """A scene and its lights for a session.

    Parameters
    ----------
    scene : scene, mesh or path
        As of Relighter.
    environment : Environment, path or name, or dict of them
        The first light, or an argument of `Environment.load`; a dict holds all choices by name.
    lighting : LightingOptions
        How accurately the light is computed. A session has a tolerance and no budget.
    albedos : dict of str to (V, 3) linear or None, optional
        Albedos to choose from, None for white; the first is shown first. Default: captured and white.
    environments_folder : path, optional
        Its `.exr` and `.hdr` files can be chosen too.
    exposure : float, optional
        Display value per unit of radiance. Default: by the brightest vertices, for each light.
    state : dict, optional
        Fields of `state.State` to start with.
    cache : Cache, optional
        As of Relighter.
    lamps : dict of str to (V, 3), optional
        Name of an albedo -> radiance of surfaces under the lamps of a room, beside every environment.
    lamps_known : bool
        Whether those lamps can be separated from other light, and dimmed.
    mixture : LightBeside, optional
        Light beside the environment: captured light and placed lamps.
    lamp_source : LampSource, optional
        Lights added lamps; without it none can be added.
    object_source : ObjectSource, optional
        Lights inserted objects.
    hand_source : callable, optional
        Returns the LightByHand that sets the captured light. Called in a thread, since it may trace rays.
    part_source : PartSource, optional
        Makes parts of the capture.
    under_kept_light : callable, optional
        Returns the request of the scene under the captured light that a hand has set and kept. Called in a thread.
    splats : SplatSource, optional
        The splats of the scene, relit and shown instead of the mesh.
    """

    scene: "AnyScene"
    environment: "Environment | str | os.PathLike[str] | Mapping[str, Any]" = "studio"
    lighting: LightingOptions = field(default_factory=LightingOptions)
    albedos: Mapping[str, NDArray[np.floating] | None] | None = None
    environments_folder: str | os.PathLike[str] | None = None
    exposure: float | None = None
    state: Mapping[str, Any] | None = None
    cache: "Cache | None" = None
    lamps: Mapping[str, NDArray[np.floating]] | None = None
    lamps_known: bool = True
    mixture: "LightBeside | None" = None
    lamp_source: LampSource | None = None
    object_source: ObjectSource | None = None
    hand_source: "Callable[[], LightByHand] | None" = None
    part_source: PartSource | None = None
    splats: "SplatSource | None" = None
    under_kept_light: "Callable[[], SessionRequest] | None" = None

    @classmethod
    def of(
        cls,
        scene: "AnyScene | SessionRequest",
        environment: "Environment | str | os.PathLike[str] | Mapping[str, Any]" = "studio",
        lighting: LightingOptions | str | None = None,
        **changes: Any,
    ) -> "SessionRequest":
        """Return a request of loose arguments.

        lighting: LightingOptions or the name of a method. changes: fields of the request and of its LightingOptions,
        side by side. A request is returned with its fields changed.
        """
        own, finer = _split(cls, changes)
        if isinstance(scene, SessionRequest):
            lighting = scene.lighting if lighting is None else lighting
            return replace(scene, lighting=LightingOptions.of(lighting, **finer), **own)
        return cls(scene, environment, LightingOptions.of(lighting, **finer), **own)


@dataclass(frozen=True)
class Turntable:
    """A film of one full turn of the light. frames: pictures in it. overwrite: replace a film of that name. size: width
    and height in pixels."""

    frames: int = 72
    overwrite: bool = False
    size: tuple[int, int] = PICTURE_SIZE

    @classmethod
    def of(cls, turn: "Turntable | None", changes: dict[str, Any]) -> tuple["Turntable", dict[str, Any]]:
        """Return the turntable with those changes that are fields of it, and the other changes."""
        own, others = _split(cls, changes)
        return replace(turn or cls(), **own), others


def _split(kind: Any, changes: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The changes that are fields of a dataclass, and the others."""
    names = {each.name for each in fields(kind)}
    own = {name: value for name, value in changes.items() if name in names}
    return own, {name: value for name, value in changes.items() if name not in names}
