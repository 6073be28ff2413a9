"""A ball above a plate, its splats, and the bundle of them."""

from functools import cache

import numpy as np

from relight import Environment
from relight.engine.appearance import appearance_of
from relight.engine.relighter import Relighter
from relight.live.lights import light_of
from relight.live.live import LiveScene, live_of
from relight.transfer.settings import Settings
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

TILT = np.array([[1, 0, 0, 0.5], [0, -1, 0, 0.25], [0, 0, -1, -2], [0, 0, 0, 1.0]])  # exact in floating point

SETTINGS = Settings("raytraced", 10, 64, bounce_rays=16, bounce_tolerance=1e-3)

LIGHTS = "overcast", "noon"


@cache
def scene_and_splats(count=2500, seed=0):
    """(Scene, Splats): a ball of radius .5 whose foot is .3 above a plate of 3 x 3; the splat is tilted."""
    import open3d as o3d

    ball = o3d.geometry.TriangleMesh.create_sphere(0.5, 16).translate((0.0, 0.8, 0.0))
    plate = o3d.geometry.TriangleMesh.create_box(3.0, 0.1, 3.0).subdivide_midpoint(5).translate((-1.5, -0.1, -1.5))
    parts = []
    for part in (ball, plate):
        part.compute_vertex_normals()
        parts.append([np.asarray(a) for a in (part.vertices, part.vertex_normals, part.triangles)])
    vertices = np.concatenate([part[0] for part in parts]).astype(np.float32)
    normals = np.concatenate([part[1] for part in parts]).astype(np.float32)
    faces = np.concatenate([parts[0][2], parts[1][2] + len(parts[0][0])])
    colors = np.round(255 * (0.55 + 0.15 * np.sin(4 * vertices))).astype(np.uint8)
    scene = Scene.from_mesh(Mesh(vertices, normals, faces, colors), scene_from_splat=TILT)

    rng = np.random.default_rng(seed)
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    face = rng.choice(len(faces), count, p=area / area.sum())
    shares = rng.dirichlet((1, 1, 1), count)
    points = np.einsum("nk,nkc->nc", shares, corners[face])
    toward = np.einsum("nk,nkc->nc", shares, normals[faces[face]])
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    back = np.linalg.inv(TILT)
    turned = toward @ back[:3, :3].T
    quats = np.stack([1.0001 + turned[:, 2], -turned[:, 1], turned[:, 0], 0 * turned[:, 0]], axis=1)
    sh = np.zeros((count, 4, 3))
    sh[:, 0] = rng.uniform(-0.7, 0.7, (count, 3))
    sh[:, 1:] = rng.normal(0, 0.05, (count, 3, 3))
    means = points @ back[:3, :3].T + back[:3, 3]
    return scene, Splats(means, np.tile([0.04, 0.04, 0.002], (count, 1)), quats, rng.uniform(0.5, 0.95, count), sh)


@cache
def live_scene():
    """(Relighter, Appearance, Splats, Live) of them, all white on the capture day, the lights at exposure .7."""
    scene, splats = scene_and_splats()
    relighter = Relighter(scene)
    look = appearance_of("captured", None, relighter)
    lights = [light_of(Environment.load(name), 0.7) for name in LIGHTS]
    return relighter, look, splats, live_of(LiveScene(relighter, look, splats), lights, SETTINGS)
