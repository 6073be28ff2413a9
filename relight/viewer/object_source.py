"""The light of a session's objects: the engine, in the form that the session needs."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..insert.asked import AskedInsert
from ..lamps.asked import AskedLamp

if TYPE_CHECKING:
    from splat2mesh.render.view import View
    from splat2mesh.splats.splats import Splats

    from ..insert.inserts import InsertedLight
    from ..splats.floor_mirror import FloorMirror


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
    the objects from an exact one. floor: the floor that mirrors in the splats in an InsertedLight at an exposure, or
    None. drawn: splats with the objects as a view in the frame of the scene shows them at an exposure; the last
    argument is the number of samples along the side of a pixel. scene_from_splat: (4, 4).
    """

    asked: Sequence[AskedInsert]
    received: Callable[[NDArray[np.float32], float], NDArray[np.floating]]
    exact: "Callable[[Sequence[AskedInsert], ObjectsUnder, Callable[..., None]], InsertedLight]"
    glimpse: "Callable[[Sequence[AskedInsert], InsertedLight], InsertedLight]"
    floor: "Callable[[InsertedLight, float], FloorMirror | None]"
    drawn: "Callable[[Splats, InsertedLight, float, View, int], Splats]"
    scene_from_splat: NDArray[np.float64]
