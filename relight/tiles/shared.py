"""Data that all tiles of a relit city share, which a process reads once: the lights and the exposure, in one file, and
the whole city, coarse."""

from functools import lru_cache
from hashlib import sha256
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import mesh_from_ply_bytes
from splat2mesh.scene.scene import Scene
from splat2mesh.tiles.plan import DISTANT, FAR
from splat2mesh.tiles.store import Store, arrays_of, bytes_of_arrays

from ..albedo.division import Prior
from ..light import CAPTURED
from ..light.captured import CapturedLight
from ..light.environment import Environment
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
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return [
        Mesh(
            np.concatenate([mesh.vertices for mesh in meshes]),
            np.concatenate([mesh.normals for mesh in meshes]),
            np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]).astype(np.int32),
            np.concatenate([mesh.colors_srgb for mesh in meshes]),
        )
    ]


def write_sky(store: Store, folder: str, sky: Environment) -> None:
    """Store the new light for the tasks."""
    store.write_arrays(f"{folder}/{SKY}", **_sky_arrays(sky))


def read_sky(store: Store, folder: str) -> Environment:
    """The new light, to the bit."""
    return _sky_from(store.read_arrays(f"{folder}/{SKY}"))


def write_shared(store: Store, folder: str, shared: Shared) -> str:
    """Store the lights of a Shared; return their key."""
    arrays: dict[str, Any] = {"exposure": shared.exposure, **_sky_arrays(shared.sky)}
    if shared.capture is not None and shared.prior is not None:
        arrays |= {"capture": shared.capture.radiance}
        arrays |= {"prior_albedo": shared.prior.albedo, "prior_irradiance": shared.prior.irradiance}
    if shared.usual is not None:
        arrays |= {f"usual_{name}": value for name, value in shared.usual._asdict().items()}
    if shared.background is not None:
        arrays |= {f"background_{name}": value for name, value in shared.background.arrays().items()}
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
        prior = Prior(kept["prior_albedo"], kept["prior_irradiance"])
        shared = shared._replace(capture=Environment(kept["capture"], "the capture"), prior=prior)
    return shared._replace(
        exposure=float(kept["exposure"]),
        usual=Usual(*(kept[f"usual_{name}"] for name in Usual._fields)) if "usual_soft" in kept else None,
        background=Background.from_arrays({name.removeprefix("background_"): kept[name] for name in kept}),
        mixture=CityMixture.from_arrays(kept),
    )
