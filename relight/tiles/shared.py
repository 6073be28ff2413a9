"""Data that all tiles of a relit city share, which a process reads once: the lights and the exposure, in one file, and
the whole city, coarse."""

from functools import lru_cache
from typing import Any, NamedTuple, cast, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import mesh_from_ply_bytes
from splat2mesh.scene.scene import Scene
from splat2mesh.tiles.city import CITY, SCHEMA_VERSION
from splat2mesh.tiles.plan import DISTANT, FAR
from splat2mesh.tiles.store import Store

from ..albedo.division import Prior
from ..light import CAPTURED
from ..light.environment import Environment
from ..light.loading import CapturedLight
from ..splats.light_ratio import Usual
from .background import Background

LIGHT = "light.npz"
"""File of a relit city's folder: the lights that all tiles share."""


class CityLight(NamedTuple):
    """The light of all tiles.

    radiance, deg, name, formula: of the new light, an Environment. exposure: display value per unit of radiance.
    sky_exposure: per unit of the new light itself; for the captured light, the factor on it. usual: change of light of
    the coarse city. capture: radiance (H, W, 3) of the captured light, or None without an estimate. prior: of the
    albedo, with `capture`. background: outside all tiles, None without one or if no splats are written. beside: of more
    light, its units of the picture per unit of the new light, and metre, irradiance and candela of the LampScale; None
    where the new light is alone.
    """

    radiance: NDArray[np.float32]
    deg: float
    name: str
    formula: str
    exposure: float
    sky_exposure: float
    usual: Usual
    capture: NDArray[np.float32] | None = None
    prior: Prior | None = None
    background: Background | None = None
    beside: NDArray[np.float64] | None = None

    @property
    def sky(self) -> Environment:
        """The new light, to the bit."""
        if str(self.name) == CAPTURED and not self.radiance.any():
            return CapturedLight()
        sky = Environment(self.radiance, str(self.name), float(self.deg))
        sky.formula = str(self.formula) or None
        return sky


class CoarseCity(NamedTuple):
    """A city of T tiles. cores: (T, 2, 2) lowest and highest x and z. coarse: their coarse meshes, None where a tile
    has no surface."""

    scene_from_splat: NDArray[np.float64]
    cores: NDArray[np.float64]
    coarse: list[Mesh | None]

    def scene_of(self, chunks: list[Mesh]) -> Scene:
        """Meshes of the city as one Scene."""
        about: dict[str, Any] = {"source": {"file": "a city"}, "capture": {"from": "both"}}
        return Scene(chunks, scene_from_splat=self.scene_from_splat, **about)


class Shared(NamedTuple):
    """The data that every task reads. sky: of the CityLight."""

    city: CoarseCity
    light: CityLight
    sky: Environment


def city_of(store: Store) -> dict[str, Any]:
    """The city.json of a folder. Raises InputError without a city, or for one of a newer version."""
    if not store.exists(CITY):
        raise InputError(f"{store.root} holds no {CITY}: make a city with splat2mesh --tiles first")
    city = cast("dict[str, Any]", store.read_json(CITY))
    if city.get("schema_version", 0) > SCHEMA_VERSION:
        raise InputError(f"{store.root}: schema version {city['schema_version']}; update the tool")
    return city


def coarse_city(store: Store) -> CoarseCity:
    """The city of a folder."""
    city, coarse = city_of(store), []
    for entry in city["tiles"]:
        far, distant = (f"{entry['name']}/{twin}" for twin in (FAR, DISTANT))
        held = distant if distant in entry["files"] else far
        coarse.append(mesh_from_ply_bytes(store.read(held)) if entry["faces"] else None)
    cores = np.array([entry["core"] for entry in city["tiles"]]).reshape(-1, 2, 2)
    return CoarseCity(np.array(city["scene_from_splat"]), cores, coarse)


def write_light(store: Store, folder: str, light: CityLight) -> str:
    """Store a CityLight; return its key."""
    return store.write_arrays(f"{folder}/{LIGHT}", **flat("", light))


@lru_cache(1)
def shared_at(root: str, folder: str, key: str) -> Shared:
    """The content of a folder of the city at the root of a Store. key: of its CityLight, by which a process recognises
    content that it has read."""
    store = Store(root)
    light = cast(CityLight, restored(CityLight, "", store.read_arrays(f"{folder}/{LIGHT}", key)))
    return Shared(coarse_city(store), light, light.sky)


def flat(name: str, value: Any) -> dict[str, Any]:
    """The arrays of a NamedTuple, of those in it too, by name; none of None."""
    if not hasattr(value, "_asdict"):
        return {} if value is None else {name: value}
    parts = [flat(f"{name}_{field}".strip("_"), each) for field, each in value._asdict().items()]
    return {key: array for part in parts for key, array in part.items()}


def restored(kind: Any, name: str, kept: dict[str, Any]) -> Any:
    """The NamedTuple of a kind that `flat` took apart; None without its arrays."""
    kind = next((each for each in (kind, *get_args(kind)) if hasattr(each, "_fields")), kind)
    if not hasattr(kind, "_fields"):
        return kept.get(name)
    parts = [restored(each, f"{name}_{field}".strip("_"), kept) for field, each in get_type_hints(kind).items()]
    return kind(*parts) if any(part is not None for part in parts) else None
