"""What workers do for a relit city: one light for all tiles, found on the coarse city; then tile by tile."""

import io
from typing import Any

import numpy as np

from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import mesh_ply_bytes
from splat2mesh.splats.formats.inria import inria_ply_bytes
from splat2mesh.splats.joining import joined
from splat2mesh.splats.splats import NUMBERS, Splats
from splat2mesh.tiles.glb import glb_bytes
from splat2mesh.tiles.store import Store

from ..albedo.division import Prior
from ..engine.appearance import CAPTURE, LEAST_ALBEDO
from ..light.environment import Environment
from ..options import LightingOptions
from .local import city_of, far_scene, local_scene

LIGHT = "light.npz"
"""Of a relit city's folder: the light of the capture and the exposure, the same for all tiles."""


def common_light(
    store: Store,
    folder: str,
    env: Environment,
    options: LightingOptions,
    albedo: str,
    ev: float | None,
) -> dict[str, Any]:
    """Tell the light of the capture and the exposure from the coarse city: FOLDER/light.npz; what it is like."""
    from ..albedo import estimate
    from ..engine.relighter import Relighter
    from ..light.tonemap import auto_exposure

    scene = far_scene(store, city_of(store))
    relighter = Relighter(scene, options)
    captured = scene.colors_linear
    arrays: dict[str, Any] = {"capture": np.ones((1, 1, 3), np.float32), "separable": False}
    told: dict[str, Any] = {"vertices": len(captured)}
    colors: Any = captured
    brightness: Any = None
    if albedo == "estimated":
        found = estimate(relighter.occluder, captured, options.seed, **relighter.computed(CAPTURE))
        arrays = {
            "capture": found.environment.radiance,
            "separable": found.separable,
            "prior_albedo": found.prior.albedo,
            "prior_irradiance": found.prior.irradiance,
        }
        told |= {
            "separable": bool(found.separable),
            "reason": found.reason,
            "evidence": round(float(found.evidence), 3),
        }
        colors, brightness = found.albedo, found.brightness
    elif albedo == "white":
        colors = None
    exposure = 2.0**ev if ev is not None else auto_exposure(relighter.shade(env, colors))
    if ev is None and brightness is not None and env.mean_luminance > 0:
        exposure = float(min(max(brightness / env.mean_luminance, exposure / 2.0), exposure * 2.0))
    store.write_arrays(f"{folder}/{LIGHT}", exposure=exposure, **arrays)
    return {**told, "exposure": float(exposure)}


def relit_tile(
    store: Store,
    folder: str,
    env: Environment,
    options: LightingOptions,
    albedo: str,
    formats: tuple[str, ...],
    tile: int,
    sources: list[int],
    distance: float,
) -> dict[str, Any]:
    """Light one tile: files of `formats` in FOLDER/tiles/TILE, and their record, which is returned."""
    city = city_of(store)
    entry = city["tiles"][tile]
    name, files, facts = f"{folder}/{entry['name']}", {}, {"tile": tile, "vertices": 0}
    if entry["faces"]:
        files, facts = _lit(store, folder, env, options, albedo, formats, tile, sources, distance, city)
    elif "splat" in formats:
        splats = _source(store, tile, sources)
        files = {"splats.ply": inria_ply_bytes(splats)} if splats is not None else {}
    return store.commit(f"{name}/relit.json", {f"{name}/{file}": data for file, data in files.items()}, **facts)


def _lit(store, folder, env, options, albedo, formats, tile, sources, distance, city):
    from ..engine.relighter import Relighter

    local = local_scene(store, city, tile, distance)
    kept = store.read_arrays(f"{folder}/{LIGHT}")
    exposure = float(kept["exposure"])
    relighter = Relighter(local.scene, options)
    captured = local.scene.colors_linear
    colors, before = _albedo(relighter, captured, kept, albedo, options.seed)
    shading = relighter.shading(env, colors)
    own = slice(0, local.own)
    radiance = shading.radiance[own]
    mesh = local.scene.chunks[0]
    shown = np.clip(radiance * np.float32(exposure), 0.0, 1.0)
    files = {}
    if "glb" in formats:
        files["mesh.glb"] = glb_bytes(mesh.vertices, mesh.normals, mesh.faces, shown)
    if "ply" in formats:
        relit = Mesh(mesh.vertices, mesh.normals, mesh.faces, bytes_from_unit(srgb_from_linear(shown)))
        files["mesh.ply"] = mesh_ply_bytes(relit)
    if "npy" in formats:
        buffer = io.BytesIO()
        np.save(buffer, radiance)
        files["radiance.npy"] = buffer.getvalue()
    if "splat" in formats and (splats := _source(store, tile, sources)) is not None:
        after = shading.radiance if colors is None else shading.radiance / np.maximum(colors, np.float32(LEAST_ALBEDO))
        files["splats.ply"] = inria_ply_bytes(_relit_splats(splats, local, before, after, exposure))
    bounds = [mesh.vertices.min(axis=0).tolist(), mesh.vertices.max(axis=0).tolist()]
    facts = {"tile": tile, "vertices": len(radiance), "lit_with": len(captured), "bounds": bounds}
    return files, facts | {"bands": shading.settings.bands, "rays": shading.settings.rays, "suns": shading.sun_count}


def _albedo(relighter, captured, kept, choice, seed):
    """Albedo (V, 3) or None for white, and what was received on the capture day, (V, 3)."""
    from ..albedo.estimate import under_light

    if choice == "white":
        return None, captured
    if choice == "captured" or not kept["separable"]:
        return captured, np.ones_like(captured)
    light = Environment(kept["capture"], "the capture")
    prior = Prior(kept["prior_albedo"], kept["prior_irradiance"])
    return under_light(relighter.occluder, captured, light, prior, seed, **relighter.computed(CAPTURE))


def _source(store, tile, sources):
    """The splats of a tile as the source has them, in its frame, or None."""
    parts = [store.read_arrays(f"splats/{number:05d}_{tile:05d}.npz") for number in sources]
    return joined([Splats(**{name: part[name] for name in NUMBERS}) for part in parts]) if parts else None


def _relit_splats(splats, local, before, after, exposure):
    """Splats that take the change of light of the mesh near them; without a fit in views, which borders would show."""
    from splat2mesh.scene.scene import Scene

    from ..splats.binding import Binding

    near = Scene(local.scene.chunks[: local.near], scene_from_splat=local.scene.scene_from_splat)
    count = near.vertex_count
    return Binding(splats, near, views=()).relit(before[:count], after[:count], exposure)


def relit_far(store: Store, folder: str, env: Environment, piece: int, eye: list[float], sky: str) -> dict[str, Any]:
    """The far background of a piece in the new light: FOLDER/far/PIECE.ply."""
    from ..splats.sky import under_sky

    name = f"{folder}/far/{piece:05d}"
    kept = store.read_arrays(f"splats/far_{piece:05d}.npz")
    splats = Splats(**{field: kept[field] for field in NUMBERS})
    if sky != "keep":
        exposure = float(store.read_arrays(f"{folder}/{LIGHT}")["exposure"])
        matrix = np.array(city_of(store)["scene_from_splat"])
        rows = np.flatnonzero(np.isfinite(splats.means).all(axis=1))
        splats = under_sky(splats, rows, env, matrix, exposure, sky, np.array(eye))
    return store.commit(f"{name}.json", {f"{name}.ply": inria_ply_bytes(splats)}, piece=piece, splats=len(splats))
