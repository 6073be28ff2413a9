"""The engine behind a session, in the form that its lamps, its objects and its captured light need."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.raycaster import Hits

from ..engine.light_mix import LightBeside
from ..engine.placed import LampLight, Placed
from ..insert.asked import AskedInsert
from ..lamps.asked import AskedLamp, LampScale

if TYPE_CHECKING:
    from splat2mesh.render.view import View
    from splat2mesh.splats.splats import Splats

    from ..engine.by_hand import LightByHand
    from ..insert.inserts import InsertedLight
    from ..splats.grown_part import GrowingSurface


class LampSum(NamedTuple):
    """The light of several lamps: (V, 3) float32 exit radiance, and irradiance over pi."""

    radiance: NDArray[np.float32]
    received: NDArray[np.float32]


class LampSource(NamedTuple):
    """A scene whose lamps can be changed.

    asked, captured: the lamps at the start, in the frame of the splat, and the factor on the captured light. prepare:
    the long work, done once. light_of: the LampLight of lamps beside a factor on the captured light. mixture: the
    LightBeside of a factor on the captured light and of lamps, or None for no lamps. scale: the LampScale. first_hits:
    the hits of rays (N, 6) in the frame of the scene; distances in lengths of their directions. command: the command
    that relights with the saved lamps.
    """

    asked: Sequence[AskedLamp]
    captured: float
    prepare: Callable[[], None]
    light_of: Callable[[Sequence[AskedLamp], float], LampLight]
    mixture: Callable[[float, Placed | LampSum | None], LightBeside]
    scale: Callable[[], LampScale]
    first_hits: Callable[[NDArray[np.float32]], Hits]
    scene_from_splat: NDArray[np.float64]
    command: str = ""


class ObjectsUnder(NamedTuple):
    """The light on objects. environment: the argument of `light_of`, or None. angle_deg: its rotation. env_scale,
    captured: factors on it and on the captured light. lamps: added ones. level: units of the picture per unit of the
    radiance. radiance, received: (V, 3) of the scene without the objects, exit radiance and irradiance over pi."""

    environment: Any
    angle_deg: float
    env_scale: float
    captured: float
    lamps: Sequence[AskedLamp]
    level: float
    radiance: NDArray[np.float32]
    received: NDArray[np.float32]


class ObjectSource(NamedTuple):
    """A scene whose objects can be moved.

    asked: the objects at the start. received: returns the irradiance over pi (V, 3) of the scene for the radiance of
    an environment and its exposure. exact: the InsertedLight of objects under a light, with all rays; calls its
    last argument often, which may raise to end it. glimpse: the same with few rays, without bounces, with the light on
    the objects from an exact one. drawn: splats with the objects as a view in the frame of the scene shows them at an
    exposure; the last
    argument is the number of samples along the side of a pixel. scene_from_splat: (4, 4).
    """

    asked: Sequence[AskedInsert]
    received: Callable[[NDArray[np.float32], float], NDArray[np.floating]]
    exact: "Callable[[Sequence[AskedInsert], ObjectsUnder, Callable[..., None]], InsertedLight]"
    glimpse: "Callable[[Sequence[AskedInsert], InsertedLight], InsertedLight]"
    drawn: "Callable[[Splats, InsertedLight, float, View, int], Splats]"
    scene_from_splat: NDArray[np.float64]


class HandSource(NamedTuple):
    """A scene whose captured light can be set. lights: returns its LightByHand, called in a thread since it may trace
    rays. first_hits: of rays (N, 6) float32, scene frame."""

    lights: "Callable[[], LightByHand]"
    first_hits: Callable[[NDArray[np.float32]], Hits]


class PartSource(NamedTuple):
    """A scene whose capture can be parted. surface: returns the GrowingSurface, which takes long. first_hits: of rays
    (N, 6) float32, scene frame. splats: every row of the capture. folder: of the scene, where parts are kept."""

    surface: "Callable[[], GrowingSurface]"
    first_hits: Callable[[NDArray[np.float32]], Hits]
    splats: "Splats"
    scene_from_splat: NDArray[np.float64]
    folder: Path
