"""The pipeline of splat2mesh: a trained splat file in, a scene out."""

import warnings

import numpy as np

from .base.errors import DataWarning, InputError
from .base.progress import Stages
from .scene.chunks import DEFAULT_MAX_VERTICES
from .scene.mesh import Mesh
from .scene.scene import Scene
from .scene.sources import describe
from .splats.formats import check_lod, read_splats
from .splats.splats import clean
from .surface.background import far_background, views_from_within
from .surface.extract import EFFORTS, WAYS, as_trained, extract, training_pixel
from .views.cameras import spread_out, trained_views
from .views.upright import UP_CHOICES, upright
from .views.viewpoints import bounds_of, picture_view, virtual_views

DEFAULT_VERTICES = 50_000

BACKGROUNDS = ("cut", "keep")
"""What becomes of a far background: a shell of it around the scene would keep all new light out."""

BACKGROUND_SHARE = 0.15
"""Of the vertices, for a background that is kept: it is far away from everyone who looks."""

LONGEST_HOLE = 0.5
"""Border of the largest hole that is closed, in units of the scene's diagonal."""


def convert(
    path,
    *,
    cameras=None,
    lod="auto",
    vertices=DEFAULT_VERTICES,
    max_chunk_vertices=DEFAULT_MAX_VERTICES,
    up="auto",
    detail="normal",
    surface="field",
    background="cut",
    seed=0,
    stages=None,
):
    """Make a scene from a trained splat.

    path: splat file, folder of tiles, or streamed SOG. cameras: file or folder of the cameras it was trained with, None
    for those that lie beside it, else virtual views, or "none". lod: level of a streamed SOG, as for `read_splats`.
    vertices: wanted size of the mesh.
    max_chunk_vertices: limit of each sub-mesh. up: one of frames.UP_CHOICES. detail: a key of surface.EFFORTS.
    surface: one of surface.WAYS. background: one of BACKGROUNDS, for the far background of open scenes.
    seed: of the virtual views. stages: Stages that times the work.
    Returns a Scene, not yet saved. Raises InputError for input that cannot be used.
    """
    check_settings(vertices, max_chunk_vertices, up, detail, surface, background)
    stages, lod = stages or Stages(), check_lod(lod)
    with stages.stage("read"):
        splats, counts = clean(read_splats(path, lod))
        trained = trained_views(cameras, path, splats)
        rotation, up_from = upright(up, trained, splats)
    total, splats = len(splats), splats.in_spatial_order()
    far = far_background(splats)
    parts, effort = [as_trained(splats.take(np.flatnonzero(~far)))], EFFORTS[detail]
    views = [choose_views(parts[0].splats, trained, rotation[1, :3], effort, seed, stages)]
    shares = [vertices]
    if far.any() and background == "cut":
        message = f"{far.sum()} of {total} splats are far background and were cut; `background` keep meshes them too"
        warnings.warn(message, DataWarning, stacklevel=2)
    elif far.any():
        parts.append(as_trained(splats.take(np.flatnonzero(far))))
        views.append(views_from_within(parts[0].splats, effort.pixels, rotation[1, :3]))
        shares = [round((1.0 - BACKGROUND_SHARE) * vertices), round(BACKGROUND_SHARE * vertices)]
    meshes, statistics = [], dict.fromkeys(("components_dropped", "holes_filled", "vertices_unseen"), 0)
    for part, seen_from, share in zip(parts, views, shares, strict=True):
        try:
            meshes.append(_reconstruct(part, seen_from, surface, effort, share, stages, statistics))
        except InputError:
            if part is parts[0]:
                raise
            warnings.warn("the far background shows no surface and was left out", DataWarning, stacklevel=2)
    mesh = _joined(meshes)
    if len(mesh.faces) == 0:
        raise InputError(f"{path}: no surface is left after cleaning: is this a splat of a solid object?")
    with stages.stage("picture"):
        camera = preview_camera(parts[0].splats, rotation)
    turn = rotation[:3, :3].astype(np.float32)
    statistics = {
        "splats": total + sum(counts.values()),
        **{f"splats_{reason}": count for reason, count in counts.items()},
        "splats_background": int(far.sum()),
        "views": sum(map(len, views)),
        **statistics,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
    }
    settings = {
        "detail": detail,
        "surface": surface,
        "background": background,
        "vertices": vertices,
        "max_chunk_vertices": max_chunk_vertices,
        "up": up,
        "up_from": up_from,
        "lod": lod,
        "seed": seed,
        "cameras": "trained" if trained else "virtual",
    }
    with stages.stage("chunks"):
        return Scene.from_mesh(
            Mesh(mesh.vertices @ turn.T, mesh.normals @ turn.T, mesh.faces, mesh.colors_srgb),
            max_chunk_vertices,
            scene_from_splat=rotation,
            preview_camera=camera,
            source=describe(path, lod),
            settings=settings,
            statistics=statistics,
        )


def _reconstruct(part, views, surface, effort, vertices, stages, statistics):
    """The mesh of a part (Trained) as views see it, in the splats' frame: a Mesh; counts are added to `statistics`."""
    from .scene.mesh import vertex_normals
    from .surface.clean import drop_small_components, fill_holes, trim_borders
    from .surface.color import vertex_colors, vertex_thickness
    from .surface.decimate import decimate
    from .surface.fair import fair

    splats, pixel = part
    raw, pictures = extract(surface, splats, views, pixel, effort, vertices, stages)
    with stages.stage("clean"):
        statistics["components_dropped"] += drop_small_components(raw)
    with stages.stage("decimate"):
        points, faces = decimate(np.asarray(raw.vertices), np.asarray(raw.triangles), vertices)
    with stages.stage("fair"):
        thickness = vertex_thickness(points, vertex_normals(points, faces), pictures, pixel)
        used, faces = np.unique(trim_borders(faces, np.isfinite(thickness)), return_inverse=True)
        points, faces = points[used], faces.reshape(-1, 3).astype(np.int32)
        longest = LONGEST_HOLE * float(np.linalg.norm(np.ptp(bounds_of(splats), axis=0)))
        points, faces, filled = fill_holes(points, faces, longest)
        statistics["holes_filled"] += filled
        thickness = np.append(thickness[used], np.full(filled, np.inf))
        if len(faces):
            points = fair(points, faces, thickness / pixel, pixel)
        points, normals = points.astype(np.float32), vertex_normals(points, faces)
    with stages.stage("color"):
        colors, unseen = vertex_colors(points, normals, pictures)
        statistics["vertices_unseen"] += unseen
    return Mesh(points, normals, faces, colors)


def _joined(meshes):
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return Mesh(
        *(np.concatenate([getattr(mesh, name) for mesh in meshes]) for name in ("vertices", "normals")),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]).astype(np.int32),
        np.concatenate([mesh.colors_srgb for mesh in meshes]),
    )


def check_settings(vertices, max_chunk_vertices, up, detail, surface, background="cut"):
    """Raise InputError for a setting that makes no sense."""
    if vertices < 4:
        raise InputError(f"`vertices` {vertices}: a mesh needs at least 4")
    if max_chunk_vertices < 3:
        raise InputError(f"`max_chunk_vertices` {max_chunk_vertices}: a chunk needs at least 3")
    if up not in UP_CHOICES:
        raise InputError(f"`up` {up}: expected one of {' '.join(UP_CHOICES)}")
    if detail not in EFFORTS:
        raise InputError(f"`detail` {detail}: expected one of {' '.join(EFFORTS)}")
    if surface not in WAYS:
        raise InputError(f"`surface` {surface}: expected one of {' '.join(WAYS)}")
    if background not in BACKGROUNDS:
        raise InputError(f"`background` {background}: expected one of {' '.join(BACKGROUNDS)}")


def choose_views(splats, trained, up, effort, seed, stages):
    """The views to look from: trained ones where given, else virtual ones."""
    with stages.stage("views"):
        if trained:
            return [view.resized(effort.pixels) for view in spread_out(trained, effort.views)]
        return virtual_views(splats, effort.views, effort.pixels, up, seed)


def preview_camera(splats, rotation):
    """The camera of the scene's pictures, as scene.json keeps it: eye, target, up in the scene frame and fov_deg."""
    turn, view = rotation[:3, :3], picture_view(splats, rotation[1, :3])
    distance = np.linalg.norm(view.center - bounds_of(splats).mean(axis=0))
    return {
        "eye": (turn @ view.center).tolist(),
        "target": (turn @ (view.center + view.forward * distance)).tolist(),
        "up": [0.0, 1.0, 0.0],
        "fov_deg": float(np.degrees(2 * np.arctan(view.width / 2 / view.fx))),
    }


def plan(path, *, cameras=None, lod="auto", up="auto", detail="normal", surface="field", background="cut"):
    """What `convert` would do, from the file alone: a dict of counts, the foreground's bounds, frame and settings."""
    check_settings(DEFAULT_VERTICES, DEFAULT_MAX_VERTICES, up, detail, surface, background)
    splats, counts = clean(read_splats(path, lod))
    trained = trained_views(cameras, path, splats)
    rotation, up_from = upright(up, trained, splats)
    effort = EFFORTS[detail]
    views = min(len(trained), effort.views) if trained else effort.views
    total, far = len(splats), far_background(splats)
    splats = splats.take(np.flatnonzero(~far))
    return {
        "splats": total + sum(counts.values()),
        **{f"splats_{reason}": count for reason, count in counts.items()},
        "splats_background": int(far.sum()),
        "sh_degree": splats.degree,
        "bounds_in_splat_frame": bounds_of(splats).tolist(),
        "scene_from_splat": rotation.tolist(),
        "up_from": up_from,
        "training_pixel": training_pixel(splats),
        "surface": surface,
        "background": background,
        "views": f"{views} of {len(trained)} trained" if trained else f"{views} virtual",
        "view_pixels": effort.pixels,
    }
