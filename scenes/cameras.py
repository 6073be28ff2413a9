"""The cameras that capture a scene, their visible surfaces, and their COLMAP model.

The views are in the splat's frame, as for a trained splat: y down, Rx(180) from the scene frame.
"""

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from splat2mesh.render.raycaster import RayCaster
from splat2mesh.render.view import View

SCENE_FROM_SPLAT = np.diag([1.0, -1.0, -1.0, 1.0])
"""(4, 4) rigid transform, Rx(180), its own inverse: trained splats are y-down, scenes y-up."""

FLIP = np.array([1.0, -1.0, -1.0])
"""Its diagonal: multiplies points and vectors to take them from either frame into the other."""

ORBIT_ELEVATION_DEG = {"tabletop": (8.0, 65.0), "ceramics": (8.0, 65.0), "object": (-50.0, 70.0)}
ORBIT_ELEVATION_DEG |= {"figure": (-10.0, 60.0), "machine": (-5.0, 70.0), "still-life": (8.0, 70.0)}
"""Lowest and highest ring of an orbit; a tabletop is not seen from below."""

ORBIT_DISTANCE = 2.6
"""Distance of the eye from the middle, in half diagonals: the scene then fills most of a 45 degree image."""

ORBIT_FOV_DEG, ROOM_FOV_DEG = 45.0, 75.0

ROOM_RING = np.array([1.7, 1.2])
"""Half axes (x, z) of the ellipse that the photographer of the room walks, above all furniture but the
shelf."""


def capture_views(truth, count=64, width=256):
    """`count` views that a careful photographer would take, all level: a list of View in the splat's frame.

    An object or a tabletop is circled with rising elevation; in a room the cameras walk around and look
    across it, first up, then down. A place has its own walk.
    """
    if hasattr(truth, "walk"):
        eyes, targets, fov_deg = truth.walk(np.linspace(0.0, 1.0, count))
        return _looking(eyes, targets, fov_deg, width)
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    around, rise = np.stack([np.cos(turn), np.sin(turn)], axis=1), np.linspace(0.0, 1.0, count)
    if truth.kind == "room":
        eyes = np.insert(around * ROOM_RING, 1, 1.3 + 0.6 * rise, axis=1)
        targets = np.insert(-0.5 * around * ROOM_RING, 1, 2.6 * (1.0 - rise), axis=1)
        fov_deg = ROOM_FOV_DEG
    else:
        middle = (truth.vertices.min(axis=0) + truth.vertices.max(axis=0)) / 2.0
        low, high = np.sin(np.radians(ORBIT_ELEVATION_DEG[truth.kind]))
        height = low + (high - low) * rise
        distance = ORBIT_DISTANCE * np.linalg.norm(truth.vertices.max(axis=0) - middle)
        eyes = middle + distance * np.insert(around * np.sqrt(1.0 - height**2)[:, None], 1, height, axis=1)
        targets = np.broadcast_to(middle, eyes.shape)
        fov_deg = ORBIT_FOV_DEG
    return _looking(eyes, targets, fov_deg, width)


def _looking(eyes, targets, fov_deg, width):
    pairs = zip(eyes * FLIP, targets * FLIP, strict=True)
    return [View.look_at(eye, target, (0.0, -1.0, 0.0), fov_deg, width) for eye, target in pairs]


def seen_faces(truth, views):
    """Which faces some view sees from the front, unobstructed: (F,) bool, judged at a point near each corner.

    What lies inside another solid, under the table or outside the room's walls is seen by none.
    """
    caster = RayCaster(truth.vertices, truth.faces)
    corners = truth.vertices[truth.faces].astype(np.float64)
    doubled_area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.sqrt(np.linalg.norm(doubled_area, axis=1, keepdims=True))
    outward = doubled_area / size**2
    seen = np.zeros(len(truth.faces), bool)
    for corner in range(3):
        points = 0.8 * corners[:, corner] + 0.2 * corners.mean(axis=1) + 1e-3 * size * outward
        for view in views:
            pixels, depth = view.project(points * FLIP)
            inside = (pixels >= 0).all(axis=1) & (pixels < [view.width, view.height]).all(axis=1) & (depth > 0)
            to_eye = view.center * FLIP - points
            rows = np.flatnonzero(inside & (np.einsum("ij,ij->i", to_eye, outward) > 0) & ~seen)
            seen[rows] = ~caster.occluded(np.hstack([points[rows], to_eye[rows]]), far=1.0)
    return seen


def write_colmap(folder, views):
    """Write views as a COLMAP text model without points: cameras.txt, images.txt, points3D.txt."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    cameras, images = [], []
    for number, view in enumerate(views, 1):
        intrinsics = (view.width, view.height, view.fx, view.fy, view.cx, view.cy)
        cameras.append(f"{number} PINHOLE " + " ".join(f"{value:.9g}" for value in intrinsics))
        x, y, z, w = Rotation.from_matrix(view.camera_from_world[:3, :3]).as_quat()
        pose = (w, x, y, z, *view.camera_from_world[:3, 3])
        images += [
            f"{number} " + " ".join(f"{value:.12g}" for value in pose) + f" {number} {number:04d}.png",
            "",
        ]
    (folder / "cameras.txt").write_text("\n".join(cameras) + "\n", encoding="ascii")
    (folder / "images.txt").write_text("\n".join(images) + "\n", encoding="ascii")
    (folder / "points3D.txt").write_text("", encoding="ascii")


def write_inria_cameras(path, views):
    """Write views as INRIA's cameras.json, as training leaves it beside its point_cloud folder.

    Its rotation is world_from_camera and its position the camera's centre (graphdeco-inria/gaussian-splatting,
    utils/camera_utils.py, camera_to_JSON).
    """
    entries = [
        {
            "id": number,
            "img_name": f"{number + 1:04d}",
            "width": view.width,
            "height": view.height,
            "position": view.center.tolist(),
            "rotation": view.camera_from_world[:3, :3].T.tolist(),
            "fy": view.fy,
            "fx": view.fx,
        }
        for number, view in enumerate(views)
    ]
    Path(path).write_text(json.dumps(entries) + "\n", encoding="ascii")
