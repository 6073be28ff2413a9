"""Data that all tiles of a relit city share, which a process reads once: the lights and the exposure, in one file, and
the whole city, coarse."""

from functools import lru_cache
from hashlib import sha256
from typing import Any, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import mesh_from_ply_bytes
from splat2mesh.scene.scene import Scene
from splat2mesh.tiles.plan import DISTANT, FAR
from splat2mesh.tiles.store import Store, arrays_of, bytes_of_arrays

from ..albedo.division import Prior
from ..light import CAPTURED
from ..light.environment import Environment
from ..light.loading import CapturedLight
from ..splats.light_ratio import Usual
from .background import Background
from .mixture import CityMixture

SKY, LIGHT = "sky.npz", "light.npz"
"""Files of a relit city's folder: the new light, and the data that all tiles share."""


class Shared(NamedTuple):
    """The data that every task reads. T tiles.

    cores: (T, 2, 2) lowest and highest x and z. coarse: their coarse meshes, None where a tile has no surface. sky:
    the new light. capture: the captured light, or None without an estimate. prior: of the albedo, with `capture`.
    usual: change of light of the coarse city. background: outside all tiles, None without one or if no splats are
    written. mixture: light beside the new light, or None.
    """

    scene_from_splat: NDArray[np.float64]
    cores: NDArray[np.float64]
    coarse: list[Mesh | None]
    sky: Environment
    capture: Environment | None = None
    prior: Prior | None = None
    exposure: float = 1.0
    usual: Usual | None = None
    background: Background | None = None
    mixture: CityMixture | None = None

    @property
    def sky_exposure(self) -> float:
        """Display value per unit of the new light itself; for the captured light, the factor on it."""
        if self.mixture is None:
            return self.exposure
        alone = isinstance(self.sky, CapturedLight)
        return self.exposure * (self.mixture.captured if alone else self.mixture.env_scale)

    @classmethod
    def read(cls, store: Store, folder: str, key: str) -> "Shared":
        """The content of a folder. key: its checksum, by which a process recognises content that it has read."""
        return _read_shared(store.root, folder, key)


def city_of(store: Store) -> dict[str, Any]:
    """The city.json of a folder."""
    return store.read_json("city.json")


def coarse_city(store: Store, sky: Environment) -> Shared:
    """A city under a new light, before the estimate of its captured light."""
    city = city_of(store)
    entries = city["tiles"]
    return Shared(
        np.array(city["scene_from_splat"]),
        np.array([entry["core"] for entry in entries]).reshape(-1, 2, 2),
        [_distant(store, entry) if entry["faces"] else None for entry in entries],
        sky,
    )


def _distant(store: Store, entry: dict[str, Any]) -> Mesh:
    """The entry of a tile in the shared data."""
    far, distant = (f"{entry['name']}/{twin}" for twin in (FAR, DISTANT))
    return mesh_from_ply_bytes(store.read(distant if distant in entry["files"] else far))


def scene_of(chunks: list[Mesh], shared: Shared) -> Scene:
    """Meshes of a city as one Scene."""
    matrix = shared.scene_from_splat
    return Scene(chunks, scene_from_splat=matrix, source={"file": "a city"}, capture={"from": "both"})


def joined_meshes(meshes: list[Mesh]) -> list[Mesh]:
    """Meshes as a list of one, or of none."""
    if not meshes:
        return []
    whole = Scene(meshes)
    return [Mesh(whole.vertices, whole.normals, whole.faces, whole.colors_srgb)]


def write_sky(store: Store, folder: str, sky: Environment) -> None:
    """Store the new light for the tasks."""
    store.write_arrays(f"{folder}/{SKY}", **_sky_arrays(sky))


def read_sky(store: Store, folder: str) -> Environment:
    """The new light, to the bit."""
    return _sky_from(store.read_arrays(f"{folder}/{SKY}"))


def write_shared(store: Store, folder: str, shared: Shared) -> str:
    """Store the lights of a Shared; return their key."""
    arrays: dict[str, Any] = {"exposure": shared.exposure, **_sky_arrays(shared.sky)}
    if shared.capture is not None:
        arrays["capture"] = shared.capture.radiance
    for name in ("prior", "usual", "background"):
        arrays |= flat(name, getattr(shared, name))
    if shared.mixture is not None:
        arrays |= shared.mixture.arrays()
    data = bytes_of_arrays(**arrays)
    store.write(f"{folder}/{LIGHT}", data)
    return sha256(data).hexdigest()


def _sky_arrays(sky: Environment) -> dict[str, Any]:
    return {"sky": sky.radiance, "sky_deg": sky.rotation_deg, "sky_name": sky.name, "sky_formula": sky.formula or ""}


def _sky_from(kept: dict[str, Any]) -> Environment:
    if str(kept["sky_name"]) == CAPTURED and not kept["sky"].any():
        return CapturedLight()
    sky = Environment(kept["sky"], str(kept["sky_name"]), float(kept["sky_deg"]))
    sky.formula = str(kept["sky_formula"]) or None
    return sky


@lru_cache(1)
def _read_shared(root: str, folder: str, key: str) -> Shared:
    store = Store(root)
    kept = arrays_of(store.read_unchanged(f"{folder}/{LIGHT}", key))
    shared = coarse_city(store, _sky_from(kept))
    if "capture" in kept:
        shared = shared._replace(capture=Environment(kept["capture"], "the capture"))
    return shared._replace(
        exposure=float(kept["exposure"]),
        prior=restored(Prior, "prior", kept),
        usual=restored(Usual, "usual", kept),
        background=restored(Background, "background", kept),
        mixture=CityMixture.from_arrays(kept),
    )


def flat(name: str, value: Any) -> dict[str, Any]:
    """The arrays of a NamedTuple, of those in it too, by name; none of None."""
    if not hasattr(value, "_asdict"):
        return {} if value is None else {name: value}
    parts = [flat(f"{name}_{field}", each) for field, each in value._asdict().items()]
    return {key: array for part in parts for key, array in part.items()}


def restored(kind: Any, name: str, kept: dict[str, Any]) -> Any:
    """The NamedTuple of a kind that `flat` took apart; None without its arrays."""
    if not hasattr(kind, "_fields"):
        return kept.get(name)
    parts = [restored(each, f"{name}_{field}", kept) for field, each in get_type_hints(kind).items()]
    return kind(*parts) if any(part is not None for part in parts) else None
