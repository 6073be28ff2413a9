"""A grey floor of splats in an even light, to put objects on."""

import numpy as np
import trimesh
from place_splats import wall

from relight import RelightRequest
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats.inria import write_inria_ply
from splat2mesh.splats.splats import SH_C0

GREY = 127


def grid_floor(side=41, size=8.0):
    across = np.linspace(-size / 2, size / 2, side)
    x, z = np.meshgrid(across, across)
    vertices = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1).astype(np.float32)
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + side, a + 1], 1), np.stack([a + 1, a + side, a + side + 1], 1)])
    normals = np.tile(np.float32([0, 1, 0]), (len(vertices), 1))
    return Mesh(vertices, normals, faces.astype(np.int32), np.full((len(vertices), 3), GREY, np.uint8))


def floor_place(tmp_path):
    """A grey floor of splats, as captured in an even light: its scene folder."""
    splats = wall([-4, 0, -4], [0, 0, 8], [8, 0, 0], 0.1)
    write_inria_ply(tmp_path / "floor.ply", splats)
    scene = Scene([grid_floor()], source=describe(tmp_path / "floor.ply"))
    scene.save(tmp_path / "floor")
    return tmp_path / "floor"


def obj(path, mesh):
    path.write_text(trimesh.exchange.obj.export_obj(mesh, include_normals=False))
    return path


def disc(tmp_path, radius=0.5):
    return obj(tmp_path / "disc.obj", trimesh.creation.cylinder(radius, 0.01, sections=64).apply_transform(_upright()))


def card(tmp_path, color=None):
    """A card of splats of 1 x 1 that faces +z, from its middle below: its scene folder, and the splats. color: (3,) of
    them."""
    own = wall([-0.5, 0, 0], [1, 0, 0], [0, 1, 0], 0.1)
    if color is not None:
        own.sh[:, 0] = (np.float32(color) - 0.5) / SH_C0
    write_inria_ply(tmp_path / "card.ply", own)
    side = grid_floor(11, 1.0)
    vertices = np.stack([side.vertices[:, 0], 0.5 - side.vertices[:, 2], 0 * side.vertices[:, 0]], 1).astype(np.float32)
    facing = np.tile(np.float32([0, 0, 1]), (len(vertices), 1))
    colors = side.colors_srgb if color is None else np.tile(np.uint8(255 * np.array(color)), (len(vertices), 1))
    scene = Scene([Mesh(vertices, facing, side.faces, colors)], source=describe(tmp_path / "card.ply"))
    scene.save(tmp_path / "card")
    return tmp_path / "card", own


def _upright():
    return np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])


def request(place, inserted, output, **more):
    return RelightRequest(place, inserted=inserted, albedo="captured", output=output, formats=("splat",), **more)


def rows(path):
    header, _, body = path.read_bytes().partition(b"end_header\n")
    return np.frombuffer(body, "<u4").reshape(-1, header.count(b"property"))
