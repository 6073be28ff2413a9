"""The pipeline of splat2mesh: a trained splat file in, a scene out."""

import hashlib
import os
import warnings
from typing import Any

import numpy as np

from .base import ahead
from .base.arrays import Floats, Mask, Matrix4, Vector
from .base.errors import DataWarning, InputError
from .base.progress import Stages
from .options import ConvertOptions
from .proxy import add_proxy, check_proxy
from .render.beside import beside
from .render.view import View
from .scene.chunks import split
from .scene.drawn import Drawn
from .scene.mesh import Mesh
from .scene.scene import Scene
from .scene.sources import describe
from .splats.cleaning import clean, usable
from .splats.extent import check_extent
from .splats.formats import read_splats
from .splats.placing import placed_mesh
from .splats.splats import Splats
from .surface.background import far_background, foreground_ball, views_from_within
from .surface.extract import EFFORTS, Effort, as_trained, dilated, training_pixel
from .surface.foliage import MESH as LEAVES_IN_MESH
from .surface.foliage import leaves_apart
from .surface.measure import measured_of
from .surface.place import PLACE, parted, reconstruct_place
from .surface.solid import reconstruct_object
from .texture.projection import Look
from .views.cameras import spread_out
from .views.eyes import around
from .views.located import located_views
from .views.panes import sky_in_panes
from .views.picture import place_view
from .views.standpoints import ROOM_SHARE, Standpoints, standpoints
from .views.upright import upright
from .views.viewpoints import bounds_of, near_plane, picture_view, virtual_views

DEFAULT_VERTICES = 50_000
"""Views of an object. A place gets as many as it needs."""

GROUND_VERTICES = 200_000
"""At most, of an object that was captured with the ground around it, where colours ask for more."""

AROUND = 40
"""Views from around that join those of the standpoints where a capture looked from within and from around."""

TRAINED = 2
"""Trained views for one virtual one, of a place: each of them shows a small part."""


def convert(
    path: str | os.PathLike[str],
    options: ConvertOptions | None = None,
    *,
    stages: Stages | None = None,
    **changes: Any,
) -> Scene:
    """Make a scene from one trained splat.

    Parameters
    ----------
    path : path
        Splat file, folder of tiles, or streamed SOG.
    options : ConvertOptions, optional
        How; `changes` are fields of it.
    stages : Stages, optional
        Times the work.

    Returns
    -------
    Scene
        In the y-up scene frame, not yet saved.

    Raises
    ------
    InputError
        For input that cannot be used.
    """
    asked = ConvertOptions.of(options, **changes)
    check_proxy(asked.proxy)
    stages = stages or Stages()
    with stages.stage("read"):
        loaded = read_splats(path, asked.lod)
        splats, counts = clean(loaded)
        check_extent(splats)
        rows = np.flatnonzero(usable(loaded)[0])
        trained = located_views(asked.cameras, path, asked.lod, splats)
        rotation, up_from = upright(asked.up, trained, splats, lambda: is_place(splats))
    order = splats.spatial_order()
    splats, rows = splats.take(order), rows[order]
    center, radius, far = foreground_ball(splats)
    foreground, effort = splats.take(np.flatnonzero(~far)), EFFORTS[asked.detail]
    with stages.stage("standpoints"):
        standing = standing_of(foreground, splats, asked, rotation[1, :3])
        panes = _panes(standing, foreground, splats, far)
    ahead.expect(ahead.PLACE if standing.eyes else ahead.OBJECT)
    far, solid = far | panes, splats.take(np.flatnonzero(~panes)) if panes.any() else splats
    statistics = dict.fromkeys(("components_dropped", "holes_filled", "vertices_unseen"), 0)
    backdrop = None
    if standing.kind == "outside":
        parts = [as_trained(foreground)]
        views = [choose_views(parts[0].splats, trained, rotation[1, :3], effort, asked.seed, stages)]
        if far.any() and asked.background == "keep":
            parts.append(as_trained(splats.take(np.flatnonzero(far))))
            views.append(views_from_within(parts[0].splats, effort.pixels, rotation[1, :3]))
        most = GROUND_VERTICES if asked.vertices is None and standing.share_surrounded >= ROOM_SHARE else 0
        wanted = asked.vertices or DEFAULT_VERTICES
        looks = [
            Look(part.splats, looking, np.full(len(looking), near_plane(bounds_of(part.splats))))
            for part, looking in zip(parts, views, strict=True)
        ]
        mesh = reconstruct_object(parts, views, asked.surface, effort, wanted, most, stages, statistics)
        seen_from = sum(map(len, views))
    else:
        seen, near = place_views(standing, foreground, trained, rotation[1, :3], effort, asked.seed, stages)
        overhead = standing.overhead if trained else None
        mesh, seen, near = reconstruct_place(solid, seen, near, asked.vertices, stages, statistics, overhead)
        seen_from = len(seen)
        looks = [Look(dilated(solid, PLACE.dilation * training_pixel(solid)), seen, near)]
        if asked.background == "cut":
            mesh, backdrop = parted(mesh, center, radius)
    if far.any() and asked.background == "cut":
        count = f"{far.sum()} of {len(splats)} splats"
        message = f"{count} are far background and were cut; `background` keep meshes them too"
        warnings.warn(message, DataWarning, stacklevel=2)
    if len(mesh.faces) == 0:
        raise InputError(f"{path}: no surface is left after cleaning: is this a splat of a solid object?")
    with stages.stage("picture"):
        shown = dilated(foreground, training_pixel(foreground))
        if standing.kind == "outside":
            view = picture_view(shown, rotation[1, :3], within=asked.surface != "field")
        else:
            view = place_view(mesh.vertices, mesh.faces, standing.eyes, spread_out(trained, 48), rotation[1, :3])
        camera = preview_camera(view, bounds_of(shown).mean(axis=0), rotation)
        picture = beside(splats, mesh, view, near_plane(bounds_of(foreground)))
    statistics = {
        "splats": len(splats) + sum(counts.values()),
        **{f"splats_{reason}": count for reason, count in counts.items()},
        "splats_background": int(far.sum()),
        "views": seen_from,
        **statistics,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
    }
    settings = {
        "detail": asked.detail,
        "surface": asked.surface,
        "background": asked.background,
        "vertices": asked.vertices or ("auto" if standing.eyes else DEFAULT_VERTICES),
        "max_chunk_vertices": asked.max_chunk_vertices,
        "up": asked.up,
        "up_from": up_from,
        "lod": asked.lod,
        "from": asked.stand,
        "seed": asked.seed,
        "cameras": "trained" if trained else "virtual",
    }
    with stages.stage("chunks"):
        scene = Scene.from_mesh(
            _turned(mesh, rotation),
            asked.max_chunk_vertices,
            background=split(_turned(backdrop, rotation), asked.max_chunk_vertices) if backdrop else [],
            background_splats=np.sort(rows[far]),
            scene_from_splat=rotation,
            preview_camera=camera,
            picture=picture,
            capture=_capture(standing, rotation),
            source=describe(path, asked.lod) | ({"offset": splats.facts.offset} if any(splats.facts.offset) else {}),
            settings=settings,
            statistics=statistics,
        )
    with stages.stage("measure"):
        stood = scene.capture.get("eyes") or [rotation[:3, :3] @ view.center for view in trained]
        alone = standing.kind == "outside" and standing.share_surrounded < ROOM_SHARE and not far.any()
        scene.measured = measured_of(loaded, scene.background_splats, scene.vertices, rotation, stood, alone)
    if asked.foliage != LEAVES_IN_MESH:
        with stages.stage("foliage"):
            scene = leaves_apart(scene, foreground, asked.foliage, asked.max_chunk_vertices)
            drawn = placed_mesh(Drawn(scene).mesh, np.linalg.inv(rotation))
            scene.picture = beside(splats, drawn, view, near_plane(bounds_of(foreground)))
    if asked.texture != "none":
        add_texture(scene, looks, asked.texture, stages)
    if asked.proxy:
        with stages.stage("proxy"):
            add_proxy(scene, asked.proxy, asked.seed)
    return scene


def add_texture(scene: Scene, looks: list[Look], size: int | str, stages: Stages) -> None:
    """Give a Scene that was not saved yet its texture, which `save` writes as mesh.glb.

    looks: what shows it. size: side in texels, or "auto". Raises InputError.
    """
    from .texture.glb import mesh_glb
    from .texture.texture import texture_of

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


def standing_of(foreground: Splats, splats: Splats, asked: ConvertOptions, up: Vector) -> Standpoints:
    """The Standpoints of a capture; the sugar way knows objects only."""
    if asked.surface != "field":
        return standpoints(splats, bounds_of(foreground), "outside")
    eyes = [tuple(np.subtract(eye, splats.facts.offset).tolist()) for eye in asked.eyes]
    return standpoints(splats, bounds_of(foreground), asked.stand, eyes, asked.seed, up)


def is_place(splats: Splats) -> bool:
    """Whether a capture looked from within, whatever is up."""
    foreground = splats.take(np.flatnonzero(~far_background(splats)))
    return len(foreground) > 0 and bool(standpoints(foreground, bounds_of(foreground)).eyes)


def _panes(standing: Standpoints, foreground: Splats, splats: Splats, far: Mask) -> Mask:
    """Which splats are sky in the windows of a room, (N,) bool: none of other captures."""
    if standing.kind != "inside":
        return np.zeros(len(splats), bool)
    return sky_in_panes(splats, far, bounds_of(foreground), standing.eyes)


def _turned(mesh: Mesh, rotation: Matrix4) -> Mesh:
    turn = rotation[:3, :3].astype(np.float32)
    return Mesh(mesh.vertices @ turn.T, mesh.normals @ turn.T, mesh.faces, mesh.colors_srgb)


def _capture(standing: Standpoints, rotation: Matrix4) -> dict[str, Any]:
    """The entry of scene.json on Standpoints: `from`, and for a place `eyes` in the scene frame and `focal_px`."""
    if not standing.eyes:
        return {"from": standing.kind}
    eyes = [(rotation[:3, :3] @ eye.center).tolist() for eye in standing.eyes]
    return {"from": standing.kind, "eyes": eyes, "focal_px": standing.focal}


def choose_views(
    splats: Splats, trained: list[View], up: Vector, effort: Effort, seed: int, stages: Stages
) -> list[View]:
    """Return the views to look from: trained ones where given, else virtual ones."""
    with stages.stage("views"):
        if trained:
            return [view.resized(effort.pixels) for view in spread_out(trained, effort.views)]
        return virtual_views(splats, effort.views, effort.pixels, up, seed, tell=True)


def place_views(
    standing: Standpoints,
    foreground: Splats,
    trained: list[View],
    up: Vector,
    effort: Effort,
    seed: int,
    stages: Stages,
) -> tuple[list[View], Floats]:
    """Return the views of a place and their near planes.

    They are trained ones, or look from its standpoints and, in the open, from around it.
    """
    plane = near_plane(bounds_of(foreground))
    with stages.stage("views"):
        if trained:
            views = [view.resized(effort.pixels) for view in spread_out(trained, TRAINED * effort.views)]
            return views, np.full(len(views), plane)
        views, near = around(standing.eyes, effort.pixels, up)
        if standing.kind == "both":
            more = virtual_views(as_trained(foreground).splats, AROUND, effort.pixels, up, seed, standing.space)
            views, near = views + more, np.append(near, np.full(len(more), plane))
        return views, near


def preview_camera(view: View, middle: Vector, rotation: Matrix4) -> dict[str, Any]:
    """Return the camera of the scene's pictures, as scene.json keeps it: eye, target, up in its frame and fov_deg.

    view: View in the splat's frame. middle: (3,) of what it shows; the target lies as far away.
    """
    turn, distance = rotation[:3, :3], np.linalg.norm(view.center - middle)
    return {
        "eye": (turn @ view.center).tolist(),
        "target": (turn @ (view.center + view.forward * distance)).tolist(),
        "up": [0.0, 1.0, 0.0],
        "fov_deg": float(np.degrees(2 * np.arctan(view.width / 2 / view.fx))),
    }


def plan(path: str | os.PathLike[str], options: ConvertOptions | None = None, **changes: Any) -> dict[str, Any]:
    """Return what `convert` would do, from the file alone: counts, the foreground's bounds, frame and settings.

    Arguments and errors as of `convert`.
    """
    asked = ConvertOptions.of(options, **changes)
    splats, counts = clean(read_splats(path, asked.lod))
    check_extent(splats)
    trained = located_views(asked.cameras, path, asked.lod, splats)
    rotation, up_from = upright(asked.up, trained, splats, lambda: is_place(splats))
    effort = EFFORTS[asked.detail]
    total, far = len(splats), far_background(splats)
    foreground = splats.take(np.flatnonzero(~far))
    standing = standing_of(foreground, splats, asked, rotation[1, :3])
    far |= _panes(standing, foreground, splats, far)
    splats = foreground
    if trained:
        wanted = effort.views * (TRAINED if standing.eyes else 1)
        views = f"{min(len(trained), wanted)} of {len(trained)} trained"
    elif standing.eyes:
        views = f"{6 * len(standing.eyes)} from {len(standing.eyes)} standpoints"
        views += f", {AROUND} or more from around" if standing.kind == "both" else ""
    else:
        views = f"{effort.views} virtual"
    return {
        "splats": total + sum(counts.values()),
        **{f"splats_{reason}": count for reason, count in counts.items()},
        "splats_background": int(far.sum()),
        "sh_degree": splats.degree,
        "bounds_in_splat_frame": bounds_of(splats).tolist(),
        "scene_from_splat": rotation.tolist(),
        "up_from": up_from,
        "training_pixel": training_pixel(splats),
        "surface": asked.surface,
        "background": asked.background,
        "from": standing.kind,
        "views": views,
        "view_pixels": effort.pixels,
        "vertices": f"{asked.vertices or DEFAULT_VERTICES:,} or fewer"
        if asked.vertices or not standing.eyes
        else "as many as the surface needs",
    }
