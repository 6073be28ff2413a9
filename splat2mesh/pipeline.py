"""The pipeline of splat2mesh: a trained splat file in, a scene out."""

import hashlib
from pathlib import Path

import numpy as np

from .cameras import read_colmap, spread_out
from .chunks import DEFAULT_MAX_VERTICES
from .errors import InputError
from .formats import read_splats
from .frames import UP_CHOICES, scene_from_splat
from .meshfile import Mesh
from .scene import Scene
from .splats import clean
from .stages import Stages
from .surface import EFFORTS, WAYS, dilated, extract, training_pixel
from .viewpoints import bounds_of, picture_view, virtual_views

DEFAULT_VERTICES = 50_000

LONGEST_HOLE = 0.2
"""Border of the largest hole that is closed, in units of the scene's diagonal."""


def convert(
    path,
    *,
    cameras=None,
    vertices=DEFAULT_VERTICES,
    max_chunk_vertices=DEFAULT_MAX_VERTICES,
    up="auto",
    detail="normal",
    surface="field",
    seed=0,
    stages=None,
):
    """Make a scene from a trained splat.

    path: splat file. cameras: folder of a COLMAP model, or None for virtual views. vertices: wanted size of the mesh.
    max_chunk_vertices: limit of each sub-mesh. up: one of frames.UP_CHOICES. detail: a key of surface.EFFORTS.
    surface: one of surface.WAYS. seed: of the virtual views. stages: Stages that times the work.
    Returns a Scene, not yet saved. Raises InputError for input that cannot be used.
    """
    from .coloring import vertex_colors
    from .mesh import decimate, drop_small_components, fill_holes

    check_settings(vertices, max_chunk_vertices, up, detail, surface)
    stages = stages or Stages()
    with stages.stage("read"):
        splats, counts = clean(read_splats(path))
        trained = read_colmap(cameras) if cameras else []
    rotation = scene_from_splat(up, trained)
    pixel = training_pixel(splats)
    splats = dilated(splats.in_spatial_order(), pixel)
    views = choose_views(splats, trained, rotation[1, :3], EFFORTS[detail], seed, stages)
    raw, pictures = extract(surface, splats, views, pixel, EFFORTS[detail], vertices, stages)
    with stages.stage("clean"):
        dropped = drop_small_components(raw)
        filled = fill_holes(raw, LONGEST_HOLE * float(np.linalg.norm(np.ptp(bounds_of(splats), axis=0))))
    with stages.stage("decimate"):
        points, normals, faces = decimate(raw, vertices)
    if len(faces) == 0:
        raise InputError(f"{path}: no surface is left after cleaning: is this a splat of a solid object?")
    with stages.stage("color"):
        colors, unseen = vertex_colors(points, normals, pictures)
    with stages.stage("picture"):
        camera = preview_camera(splats, rotation)
    turn = rotation[:3, :3].astype(np.float32)
    statistics = {
        "splats": len(splats) + sum(counts.values()),
        **{f"splats_{reason}": count for reason, count in counts.items()},
        "views": len(views),
        "components_dropped": dropped,
        "holes_filled": filled,
        "vertices": len(points),
        "faces": len(faces),
        "vertices_unseen": unseen,
    }
    settings = {
        "detail": detail,
        "surface": surface,
        "vertices": vertices,
        "max_chunk_vertices": max_chunk_vertices,
        "up": up,
        "seed": seed,
        "cameras": "trained" if trained else "virtual",
    }
    with stages.stage("chunks"):
        return Scene.from_mesh(
            Mesh(points @ turn.T, normals @ turn.T, faces, colors),
            max_chunk_vertices,
            scene_from_splat=rotation,
            preview_camera=camera,
            source={"file": Path(path).name, "sha256": fingerprint(path)},
            settings=settings,
            statistics=statistics,
        )


def check_settings(vertices, max_chunk_vertices, up, detail, surface):
    """Raise InputError for a setting that makes no sense."""
    if vertices < 4:
        raise InputError(f"--vertices {vertices}: a mesh needs at least 4")
    if max_chunk_vertices < 3:
        raise InputError(f"--max-chunk-vertices {max_chunk_vertices}: a chunk needs at least 3")
    if up not in UP_CHOICES:
        raise InputError(f"--up {up}: expected one of {' '.join(UP_CHOICES)}")
    if detail not in EFFORTS:
        raise InputError(f"--detail {detail}: expected one of {' '.join(EFFORTS)}")
    if surface not in WAYS:
        raise InputError(f"--surface {surface}: expected one of {' '.join(WAYS)}")


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


def fingerprint(path):
    """SHA-256, as a hex string, of a file, or of all files of a folder in the order of their names.

    The meta.json of an unbundled .sog stands for its folder.
    """
    path = Path(path)
    path = path.parent if path.name == "meta.json" else path
    digest = hashlib.sha256()
    for part in sorted(path.iterdir()) if path.is_dir() else [path]:
        if part.is_file():
            with open(part, "rb") as file:
                while block := file.read(1 << 20):
                    digest.update(block)
    return digest.hexdigest()


def plan(path, *, cameras=None, up="auto", detail="normal", surface="field"):
    """What `convert` would do, from the file alone: a dict of counts, bounds, frame and settings."""
    check_settings(DEFAULT_VERTICES, DEFAULT_MAX_VERTICES, up, detail, surface)
    splats, counts = clean(read_splats(path))
    trained = read_colmap(cameras) if cameras else []
    effort = EFFORTS[detail]
    views = min(len(trained), effort.views) if trained else effort.views
    return {
        "splats": len(splats) + sum(counts.values()),
        **{f"splats_{reason}": count for reason, count in counts.items()},
        "sh_degree": splats.degree,
        "bounds_in_splat_frame": bounds_of(splats).tolist(),
        "scene_from_splat": scene_from_splat(up, trained).tolist(),
        "training_pixel": training_pixel(splats),
        "surface": surface,
        "views": f"{views} of {len(trained)} trained" if trained else f"{views} virtual",
        "view_pixels": effort.pixels,
    }
