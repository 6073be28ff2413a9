"""Light on an inserted object against Mitsuba 3's path tracer, with the light given and with the light estimated.

A grey ball stands on a generated table top. Given: the light and the albedo are the true ones. Estimated: only the
colours of the scene under the light are known. Errors are relative L2 norms of the ball's radiance over the pixels of
two pictures; "one gain" is after a factor for all colours.
"""

import tempfile

import numpy as np

from benchmarks.bounces import diffuse_solid
from benchmarks.shapes import shape
from relight import RelightRequest, relight_scene
from relight.insert.asked import AskedInsert
from relight.jobs.job import Job
from relight.light.environment import Environment
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

QUICK = ["--vertices", "3000", "--lights", "overcast", "--paths", "16", "--side", "16"]
ALBEDO, SIZE, SHARE, FIELD_DEG = 0.5, 0.06, 0.92, 22.0
"""Of the ball; its radius in diagonals of the scene; what the brightest vertices show of the picture's range; field of
view of the pictures that are compared."""


def arguments(parser):
    parser.add_argument("--vertices", type=int, default=40_000, metavar="N", help="of the table top")
    parser.add_argument("--lights", nargs="+", default=["overcast", "studio", "sunset"])
    parser.add_argument("--paths", type=int, default=512, help="for each pixel")
    parser.add_argument("--side", type=int, default=40, metavar="PIXELS", help="of the two pictures of the ball")
    parser.add_argument("--at", default="0.5,0.5", help="where it stands, as shares of the scene's extent in x and z")


def run(options, report):
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    columns = dict.fromkeys(("given", "estimated", "one_gain", "gain"), ".3f")
    table = report.table("what the object sends, relative error", light="<10", **columns, seconds=".1f")
    mesh = shape("tabletop", options.vertices)
    for name in options.lights:
        table.add(light=name, **errors(mesh, Environment.load(name), options))


def errors(mesh, light, options):
    """Relative errors of the light on the ball under one light."""
    scene = Scene([Mesh(mesh.vertices, mesh.normals, mesh.faces, bytes_from_unit(srgb_from_linear(mesh.albedo)))])
    ball = ball_object(SIZE * scene.diagonal)
    low, high = scene.bounds
    x, z = (float(share) for share in options.at.split(","))
    at = (low[0] + x * (high[0] - low[0]), float(high[1]), low[2] + z * (high[2] - low[2]))
    asked = AskedInsert(ball, tuple(map(float, at)), on="floor", albedo=(ALBEDO,) * 3)
    known = {"inserted": (asked,), "caching": "none", "formats": ("npy",)}
    given = next(Job(RelightRequest(scene, light, albedo=mesh.albedo, **known)).shaded())
    found = given.inserted
    truth, corners, weights = _traced(mesh, found.standing, light, options)
    lit = relight_scene(scene, light, albedo=mesh.albedo, tolerance=0.005, caching="none").radiance
    exposure = SHARE / np.percentile(lit, 99.0)
    colors = bytes_from_unit(srgb_from_linear(np.clip(lit * exposure, 0.0, 1.0)))
    captured = Scene([Mesh(mesh.vertices, mesh.normals, mesh.faces, colors)])
    job = Job(RelightRequest(captured, "captured", albedo="estimated", **known))
    guessed = _seen(next(job.shaded()).inserted.radiance, corners, weights) / exposure
    exact = _seen(found.radiance, corners, weights)
    gain = float((truth * guessed).sum() / (guessed**2).sum())
    norm = np.linalg.norm(truth)
    return {
        "given": np.linalg.norm(exact - truth) / norm,
        "estimated": np.linalg.norm(guessed - truth) / norm,
        "one_gain": np.linalg.norm(gain * guessed - truth) / norm,
        "gain": gain,
        "seconds": job.stages.seconds["light on objects"],
    }


def _traced(mesh, standing, light, options):
    """Radiance (N, 3) of pixels that show the ball by path tracing, and the ball's faces (N,) and weights (N, 3)."""
    import mitsuba as mi

    both, middle = _Both(mesh, standing), standing.vertices.mean(axis=0).astype(float)
    reach = 3.0 * np.linalg.norm(np.ptp(standing.vertices, axis=0))
    with tempfile.TemporaryDirectory() as folder:
        solid = diffuse_solid(both, f"{folder}/both.ply")
        film = {"type": "hdrfilm", "width": options.side, "height": options.side, "rfilter": {"type": "box"}}
        found = []
        for away in ([0.8, 0.6, 0.5], [-0.8, 0.5, -0.6]):
            eye = middle + reach * np.array(away) / np.linalg.norm(away)
            pose = mi.ScalarTransform4f().look_at(eye.tolist(), middle.tolist(), [0, 1, 0])
            sensor = {"type": "perspective", "fov": FIELD_DEG, "to_world": pose, "film": film}
            sensor["sampler"] = {"type": "independent", "sample_count": options.paths}
            lit = {"type": "envmap", "bitmap": mi.Bitmap(np.array(light.radiance))}
            scene = mi.load_dict({"type": "scene", "solid": solid, "light": lit, "sensor": sensor})
            image = np.array(mi.render(scene, integrator=mi.load_dict({"type": "path", "max_depth": 12})))
            found.append(_on_ball(image, scene.sensors()[0], both, standing, len(mesh.faces), len(mesh.vertices)))
    return tuple(np.concatenate(each) for each in zip(*found, strict=True))


def _on_ball(image, sensor, both, standing, first_face, first_vertex):
    """The pixels of a picture that show only objects."""
    side = len(image)
    steps = (np.arange(side) + 0.5) / side
    rays = []
    for y in steps:
        for x in steps:
            ray, _ = sensor.sample_ray(0.0, 0.5, [x, y], [0.5, 0.5])
            rays.append([*np.array(ray.o).ravel(), *np.array(ray.d).ravel()])
    hits = RayCaster(both.vertices, both.faces).first_hits(np.array(rays, np.float32))
    shows = (hits.faces >= first_face).reshape(side, side)
    inner = shows & np.roll(shows, 1, 0) & np.roll(shows, -1, 0) & np.roll(shows, 1, 1) & np.roll(shows, -1, 1)
    rows = np.flatnonzero(inner.ravel())
    uv = hits.uv[rows]
    corners = both.faces[hits.faces[rows]] - first_vertex
    return image.reshape(-1, image.shape[-1])[rows, :3], corners, np.concatenate([1 - uv.sum(1, keepdims=True), uv], 1)


def _seen(radiance, corners, weights):
    return np.einsum("nk,nkc->nc", weights, radiance[corners])


class _Both:
    """Table and objects as one mesh with an albedo."""

    def __init__(self, mesh, standing):
        self.vertices = np.concatenate([mesh.vertices, standing.vertices])
        self.normals = np.concatenate([mesh.normals, standing.normals])
        self.faces = np.concatenate([mesh.faces, standing.faces + len(mesh.vertices)])
        self.albedo = np.concatenate([mesh.albedo, standing.albedo])


def ball_object(radius):
    import trimesh

    ball = trimesh.creation.icosphere(3, radius=radius)
    white = np.full(ball.vertices.shape, 255, np.uint8)
    return Mesh(np.float32(ball.vertices), np.float32(ball.vertices / radius), np.int32(ball.faces), white)
