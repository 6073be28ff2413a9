"""The pipeline of splat2mesh: a trained splat file in, a scene out, by its capture, looks at it and their surface."""

import hashlib
import os
import warnings
from typing import Any, NamedTuple

import numpy as np

from .base.arrays import Matrix4, Vector
from .base.choices import DEFAULT_VERTICES
from .base.errors import DataWarning, InputError
from .base.progress import Stages
from .capture import Capture, capture_of
from .options import ConvertOptions
from .proxy import add_proxy, check_proxy
from .render.beside import beside
from .render.view import View
from .scene.chunks import split
from .scene.drawn import Drawn
from .scene.mesh import Mesh
from .scene.scene import Scene
from .scene.sources import describe
from .splats.placing import placed_mesh
from .splats.splats import Splats
from .surface.background import views_from_within
from .surface.extract import EFFORTS, Effort, Look, as_trained, dilated, training_pixel
from .surface.foliage import MESH as LEAVES_IN_MESH
from .surface.foliage import leaves_apart
from .surface.measure import measured_of
from .surface.place import parted, place_look, reconstruct_place
from .surface.solid import reconstruct_object
from .texture.glb import mesh_glb
from .texture.texture import texture_of
from .views.cameras import spread_out
from .views.eyes import around
from .views.picture import mesh_depth, place_view
from .views.standpoints import ROOM_SHARE, Standpoints
from .views.viewpoints import bounds_of, near_plane, picture_view, virtual_views

GROUND_VERTICES = 200_000
"""At most, of an object that was captured with the ground around it, where colours ask for more."""

AROUND = 40
"""Views from around that join those of the standpoints where a capture looked from within and from around."""

TRAINED, PICTURED = 2, 48
"""Trained views for one virtual one, of a place, as each of them shows a small part; and those at most that its picture
is chosen among."""


class SeenSurface(NamedTuple):
    """What views of a splat show, in its frame: the mesh, its far background apart, the views, and counts."""

    mesh: Mesh
    backdrop: Mesh | None
    looks: list[Look]
    statistics: dict[str, Any]


def converted(path: str | os.PathLike[str], asked: ConvertOptions, stages: Stages) -> Scene:
    """Make a scene, not yet saved, from one trained splat; see `api.convert`."""
    check_proxy(asked.proxy)
    return meshed(path, capture_of(path, asked, stages), asked, stages)


def meshed(path: str | os.PathLike[str], capture: Capture, asked: ConvertOptions, stages: Stages) -> Scene:
    """The scene of a Capture, read from a path by the same options. Errors as of `api.convert`."""
    check_proxy(asked.proxy)
    looks = _looks_of(capture, asked, stages)
    surface = _surface_of(capture, asked, looks, stages)
    if capture.far.any() and asked.background == "cut":
        count = f"{capture.far.sum()} of {len(capture.splats)} splats"
        message = f"{count} are far background and were cut; `background` keep meshes them too"
        warnings.warn(message, DataWarning, stacklevel=2)
    if len(surface.mesh.faces) == 0:
        raise InputError(f"{path}: no surface is left after cleaning: is this a splat of a solid object?")
    scene = _scene_of(path, capture, asked, surface, stages)
    if asked.texture != "none":
        add_texture(scene, surface.looks, asked.texture, stages)
    if asked.proxy:
        with stages.stage("proxy"):
            add_proxy(scene, asked.proxy, asked.seed)
    return scene


def _looks_of(capture: Capture, asked: ConvertOptions, stages: Stages) -> list[Look]:
    """What is looked at from where: a place, or an object and then its background where that is kept."""
    up, effort = capture.rotation[1, :3], EFFORTS[asked.detail]
    with stages.stage("views"):
        if capture.standing.kind != "outside":
            return [_look_of_place(capture, effort, asked.seed)]
        shown, pixel = as_trained(capture.foreground)
        if capture.trained:
            views = [view.resized(effort.pixels) for view in spread_out(capture.trained, effort.views)]
        else:
            views = virtual_views(shown, effort.views, effort.pixels, up, asked.seed)
    looks = [Look.around(shown, pixel, views)]
    if capture.far.any() and asked.background == "keep":
        behind = capture.splats.take(np.flatnonzero(capture.far))
        looks.append(Look.around(*as_trained(behind), views_from_within(shown, effort.pixels, up)))
    return looks


def _look_of_place(capture: Capture, effort: Effort, seed: int) -> Look:
    """From trained views, or from the standpoints and, in the open, from around them."""
    solid, up = capture.splats, capture.rotation[1, :3]
    if capture.panes.any():
        solid = solid.take(np.flatnonzero(~capture.panes))
    plane = near_plane(bounds_of(capture.foreground))
    if capture.trained:
        views = [view.resized(effort.pixels) for view in spread_out(capture.trained, TRAINED * effort.views)]
        return place_look(solid, views, np.full(len(views), plane))
    views, near = around(capture.standing.eyes, effort.pixels, up)
    if capture.standing.kind == "both":
        shown, _ = as_trained(capture.foreground)
        more = virtual_views(shown, AROUND, effort.pixels, up, seed, capture.standing.space)
        views, near = views + more, np.append(near, np.full(len(more), plane))
    return place_look(solid, views, near)


def _surface_of(capture: Capture, asked: ConvertOptions, looks: list[Look], stages: Stages) -> SeenSurface:
    """The mesh of what is looked at."""
    standing = capture.standing
    if standing.kind == "outside":
        most = GROUND_VERTICES if asked.vertices is None and standing.share_surrounded >= ROOM_SHARE else 0
        wanted, effort = asked.vertices or DEFAULT_VERTICES, EFFORTS[asked.detail]
        mesh, counts = reconstruct_object(looks, asked.surface, effort, wanted, most, stages)
        return SeenSurface(mesh, None, looks, counts)
    overhead = standing.overhead if capture.trained else None
    mesh, look, counts = reconstruct_place(looks[0], asked.vertices, stages, overhead)
    backdrop = None
    if asked.background == "cut":
        mesh, backdrop = parted(mesh, capture.center, capture.radius)
    return SeenSurface(mesh, backdrop, [look], counts)


def _picture_view(capture: Capture, asked: ConvertOptions, mesh: Mesh, shown: Splats) -> View:
    """The view of a scene's picture. shown: the foreground, dilated."""
    up, standing = capture.rotation[1, :3], capture.standing
    if standing.kind == "outside":
        return picture_view(shown, up)
    depth_in = mesh_depth(mesh.vertices, mesh.faces)
    return place_view(mesh.vertices, depth_in, standing.eyes, spread_out(capture.trained, PICTURED), up)


def _scene_of(
    path: str | os.PathLike[str], capture: Capture, asked: ConvertOptions, surface: SeenSurface, stages: Stages
) -> Scene:
    """The Scene of a surface, with the facts of its capture, and leaves apart on request."""
    splats, foreground, rotation, standing = capture.splats, capture.foreground, capture.rotation, capture.standing
    mesh, near = surface.mesh, near_plane(bounds_of(foreground))
    with stages.stage("picture"):
        shown = dilated(foreground, training_pixel(foreground))
        view = _picture_view(capture, asked, mesh, shown)
        camera = preview_camera(view, bounds_of(shown).mean(axis=0), rotation)
        picture = beside(splats, mesh, view, near)
    with stages.stage("chunks"):
        most, backdrop = asked.max_chunk_vertices, surface.backdrop
        offset = {"offset": splats.facts.offset} if any(splats.facts.offset) else {}
        scene = Scene.from_mesh(
            _turned(mesh, rotation),
            most,
            background=split(_turned(backdrop, rotation), most) if backdrop else [],
            background_splats=np.sort(capture.rows[capture.far]),
            scene_from_splat=rotation,
            preview_camera=camera,
            picture=picture,
            capture=_described(standing, rotation),
            source=describe(path, asked.lod) | offset,
            settings=_settings(capture, asked),
            statistics={
                **capture.counts,
                "views": sum(len(look.views) for look in surface.looks),
                **surface.statistics,
                "vertices": len(mesh.vertices),
                "faces": len(mesh.faces),
            },
        )
    with stages.stage("measure"):
        stood = scene.capture.get("eyes") or [rotation[:3, :3] @ view.center for view in capture.trained]
        alone = standing.kind == "outside" and standing.share_surrounded < ROOM_SHARE and not capture.far.any()
        scene.measured = measured_of(capture.loaded, scene.background_splats, scene.vertices, rotation, stood, alone)
    if asked.foliage != LEAVES_IN_MESH:
        with stages.stage("foliage"):
            scene = leaves_apart(scene, foreground, asked.foliage, most)
            drawn = placed_mesh(Drawn(scene).mesh, np.linalg.inv(rotation))
            scene.picture = beside(splats, drawn, view, near)
    return scene


def _settings(capture: Capture, asked: ConvertOptions) -> dict[str, Any]:
    """The settings of the request, as scene.json keeps them."""
    return {
        "detail": asked.detail,
        "surface": asked.surface,
        "background": asked.background,
        "vertices": asked.vertices or ("auto" if capture.standing.eyes else DEFAULT_VERTICES),
        "max_chunk_vertices": asked.max_chunk_vertices,
        "up": asked.up,
        "up_from": capture.up_from,
        "lod": asked.lod,
        "from": asked.stand,
        "seed": asked.seed,
        "cameras": "trained" if capture.trained else "virtual",
    }


def add_texture(scene: Scene, looks: list[Look], size: int | str, stages: Stages) -> None:
    """Give a Scene that was not saved yet its texture, which `save` writes as mesh.glb. looks: what shows it. size:
    side in texels, or "auto". Raises InputError."""
    surfaces = Drawn.surfaces(scene).scene
    made = texture_of(surfaces, looks, None if size == "auto" else int(size), stages)
    with stages.stage("texture file"):
        matrix = np.asarray(scene.scene_from_splat).ravel().tolist()
        scene.textured = mesh_glb(made, len(surfaces.chunks), {"scene_from_splat": matrix}, scene.cards)
    scene.settings = scene.settings | {"texture": size}
    digest = hashlib.sha256(scene.textured).hexdigest()
    statistics: dict[str, Any] = {
        "texture_size": made.atlas.size,
        "texels": len(made.colors),
        "texels_unseen": made.unseen,
    }
    statistics |= {"texture_scale": round(made.scale, 3), "texture_sha256": digest}
    scene.statistics = scene.statistics | statistics


def _turned(mesh: Mesh, rotation: Matrix4) -> Mesh:
    turn = rotation[:3, :3].astype(np.float32)
    return Mesh(mesh.vertices @ turn.T, mesh.normals @ turn.T, mesh.faces, mesh.colors_srgb)


def _described(standing: Standpoints, rotation: Matrix4) -> dict[str, Any]:
    """The entry of scene.json on Standpoints: `from`, and for a place `eyes` in the scene frame and `focal_px`."""
    if not standing.eyes:
        return {"from": standing.kind}
    eyes = [(rotation[:3, :3] @ eye.center).tolist() for eye in standing.eyes]
    return {"from": standing.kind, "eyes": eyes, "focal_px": standing.focal}


def preview_camera(view: View, middle: Vector, rotation: Matrix4) -> dict[str, Any]:
    """Return the camera of the scene's pictures, as scene.json keeps it: eye, target, up in its frame and fov_deg.
    view: View in the splat's frame. middle: (3,) of what it shows; the target lies as far away."""
    turn, distance = rotation[:3, :3], np.linalg.norm(view.center - middle)
    return {
        "eye": (turn @ view.center).tolist(),
        "target": (turn @ (view.center + view.forward * distance)).tolist(),
        "up": [0.0, 1.0, 0.0],
        "fov_deg": float(np.degrees(2 * np.arctan(view.width / 2 / view.fx))),
    }


def planned(path: str | os.PathLike[str], asked: ConvertOptions) -> dict[str, Any]:
    """Return what `converted` would do, from the file alone: counts, the foreground's bounds, frame and settings."""
    capture = capture_of(path, asked, Stages())
    effort, eyes, foreground = EFFORTS[asked.detail], capture.standing.eyes, capture.foreground
    if capture.trained:
        wanted = effort.views * (TRAINED if eyes else 1)
        views = f"{min(len(capture.trained), wanted)} of {len(capture.trained)} trained"
    elif eyes:
        views = f"{6 * len(eyes)} from {len(eyes)} standpoints"
        views += f", {AROUND} or more from around" if capture.standing.kind == "both" else ""
    else:
        views = f"{effort.views} virtual"
    return {
        **capture.counts,
        "sh_degree": foreground.degree,
        "bounds_in_splat_frame": bounds_of(foreground).tolist(),
        "scene_from_splat": capture.rotation.tolist(),
        "up_from": capture.up_from,
        "training_pixel": training_pixel(foreground),
        "surface": asked.surface,
        "background": asked.background,
        "from": capture.standing.kind,
        "views": views,
        "view_pixels": effort.pixels,
        "vertices": f"{asked.vertices or DEFAULT_VERTICES:,} or fewer"
        if asked.vertices or not eyes
        else "as many as the surface needs",
    }
