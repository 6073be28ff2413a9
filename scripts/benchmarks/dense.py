"""What a splat of the same thing costs as it has more Gaussians: binding, gloss, a picture of the texture.

A bumpy sphere, of Gaussians that share its area, on one mesh. Processor seconds of binding, and of the places on the
mesh in it, which follow the number of Gaussians; of the first look at gloss; and of one picture as textures take
64. With --each the same without merging, and the PSNR of a relit splat against that one, over pictures of 512 pixels.
"""

import numpy as np
import open3d as o3d

from benchmarks.harness import growth, timed
from relight.gloss.fits import observed
from relight.gloss.views import outer_looks
from relight.splats import Binding, sketch
from relight.splats import binding as binding_module
from relight.splats.attachment import Places
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

SIZES = (130_000, 400_000, 1_300_000)
QUICK = ["2000", "4000", "--each"]

SHOWN, VIEWS = 512, 8
"""Pixels of the pictures that are compared, and views around."""

TEXTURE_PIXELS = 768  # about the side of a picture of 64 for a texture


def arguments(parser):
    parser.add_argument("sizes", type=int, nargs="*", default=SIZES, metavar="SPLATS", help=f"default: {SIZES}")
    parser.add_argument("--each", action="store_true", help="also without merging")


def run(options, report):
    scene, costs = sphere(), {}
    columns = {"splats": ",", "way": "<7", "drawn": ",", "places": ".2f", "binding": ".2f", "gloss": ".2f"}
    table = report.table("processor seconds", **columns, picture=".2f", psnr=".2f")
    for size in options.sizes:
        splats, relit = bumpy_sphere(size), {}
        for way in ("each", "merged") if options.each else ("merged",):
            row, relit[way] = _measured(scene, splats, way)
            costs.setdefault(way, []).append(row["binding"] + row["gloss"])
            apart = _psnr(splats, *relit.values()) if len(relit) == 2 else None
            table.add(splats=size, way=way, **row, psnr=apart)
    for way, each in costs.items():
        if len(each) > 1:
            report.note(
                f"{way}: binding and gloss grow with exponent {growth(options.sizes, each):.2f} at the last step"
            )


def _measured(scene, splats, way):
    """Figures of one way, and the relit splat."""
    count, places = sketch.merged_count, []

    def placed(*asked):
        places.append(timed(lambda: Places(*asked)))
        return places[0].result

    sketch.merged_count, binding_module.Places = count if way == "merged" else lambda *_: 1, placed
    try:
        binding, _, bound = timed(lambda: Binding(splats, scene))
        looks, _, looked = timed(lambda: outer_looks(binding, scene))
        _, _, seen = timed(lambda: observed(binding, looks, np.eye(3), scene.colors_srgb / 255.0))
    finally:
        sketch.merged_count, binding_module.Places = count, Places
    picture = timed(lambda: rasterize(splats, views_around(splats, TEXTURE_PIXELS)[0])).cpu
    light = [np.repeat(1.0 + 0.5 * scene.normals[:, axis, None], 3, axis=1).astype(np.float32) for axis in (0, 1)]
    row = {"drawn": len(binding.sketch), "places": places[0].cpu, "binding": bound}
    return row | {"gloss": looked + seen, "picture": picture}, binding.relit(*light)


def _psnr(splats, first, second):
    """Of two relit splats, where they are seen."""
    errors = []
    for view in views_around(splats, SHOWN)[::3]:
        seen = [rasterize(each, view) for each in (first, second)]
        off = np.clip(seen[0].color, 0, 1) - np.clip(seen[1].color, 0, 1)
        errors.append(np.mean(off[seen[0].alpha > 0.5].astype(np.float64) ** 2))
    return float(-10.0 * np.log10(max(np.mean(errors), 1e-12)))


def sphere():
    """The Scene of the same sphere."""
    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 110)
    ball.vertices = o3d.utility.Vector3dVector(bump(np.asarray(ball.vertices)))
    ball.compute_vertex_normals()
    vertices, normals = (np.asarray(each, np.float32) for each in (ball.vertices, ball.vertex_normals))
    colors = np.full(vertices.shape, 128, np.uint8)
    return Scene.from_mesh(Mesh(vertices, normals, np.asarray(ball.triangles), colors), 100_000)


def bumpy_sphere(n, seed=0):
    """n flat splats of degree 3 on a bumpy unit sphere, about as large as their share of its area."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    means = bump(normal)
    scales = np.sqrt(4 * np.pi / n) * np.exp(rng.normal(0, 0.4, (n, 3))) * [1, 1, 0.1]
    z = np.broadcast_to([0.0, 0.0, 1.0], (n, 3))
    quats = np.column_stack([1 + normal[:, 2], np.cross(z, normal)])  # the half-way rotation from +z
    opacities = 1 / (1 + np.exp(-rng.normal(1.5, 2, n)))
    return Splats(means, scales, quats, opacities, rng.normal(0, 0.2, (n, 16, 3)))


def bump(normal):
    """The place (N, 3) of its surface in each direction."""
    return normal * (1 + 0.2 * np.sin(5 * normal[:, :1]) * np.cos(4 * normal[:, 1:2]))


def views_around(splats, size):
    """Views from all sides of the middle 98% of the splats, which fill most of the image."""
    low, high = np.percentile(splats.means, [1, 99], axis=0)
    center, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    angles = 2 * np.pi * np.arange(VIEWS) / VIEWS
    eyes = center + 2.5 * radius * np.column_stack([np.sin(angles), np.full(VIEWS, -0.3), -np.cos(angles)])
    return [View.look_at(eye, center, (0, -1, 0), 45, size) for eye in eyes]
