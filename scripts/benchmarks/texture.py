"""The gain of a texture for a mesh with few faces: pictures against the splat's own, albedo against the truth, time,
memory.

FOLDER holds a splat (point_cloud.ply or splat.ply) and, for --albedo, its true mesh with albedo: gt_mesh.ply in the
splat's frame, or truth.ply as `python -m scenes` writes it. A splat file alone works too. Without any, a tabletop is
generated. PSNR is of sRGB over pixels that mesh and splat cover, in views that no texture was made from. "truth" is the
relative error of albedo over points of the true mesh, one gain per colour. Times are processor seconds of all threads,
after a warm-up.
"""

import resource
import subprocess
import sys
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import open3d as o3d

from benchmarks.harness import ROOT, timed
from benchmarks.shapes import ply_vertices
from relight.texture import KnownColors, bake
from splat2mesh import convert
from splat2mesh.base.progress import Stages
from splat2mesh.render.rasterize import rasterize
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear
from splat2mesh.splats.cleaning import clean
from splat2mesh.splats.formats import read_splats
from splat2mesh.views.viewpoints import virtual_views

SAMPLES = 4  # per pixel
PIXELS = 400


QUICK = ["--splats", "5000", "--vertices", "500", "--views", "1"]


def arguments(parser):
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--up", default="auto", help="as for splat2mesh")
    parser.add_argument("--vertices", type=int, nargs="+", default=[2500, 50_000], help="of the meshes")
    parser.add_argument("--albedo", action="store_true", help="estimate the light of the capture and compare albedo")
    parser.add_argument("--views", type=int, default=8, metavar="N", help="pictures to compare")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="write some of them")
    parser.add_argument("--splats", type=int, default=40_000, help="of the generated scene")


def run(options, report):
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as work:
        folders = options.folders
        if not folders:
            folders = [Path(work, "tabletop")]
            command = [sys.executable, "-m", "scenes", folders[0], "--kind", "tabletop", "-q"]
            subprocess.run([*command, "--splats", str(options.splats)], check=True, cwd=ROOT)
        for folder in folders:
            measure(folder, options, report)


def measure(folder, options, report):
    path = folder
    if folder.is_dir():
        path = next(p for p in (folder / "point_cloud.ply", folder / "splat.ply") if p.exists())
    splats = clean(read_splats(path))[0]
    name = folder.name.split(".")[0]
    columns = {"scene": "<12", "faces": "d", "colours": "<8", "texels": "d", "unseen": ".3f", "psnr": ".2f"}
    table = report.table(**columns, cpu_s=".1f", truth=".3f")
    warm = convert(path, vertices=1000, detail="draft", up=options.up)
    bake(warm, splats, size=64)
    pictures = None
    for count in options.vertices:
        scene = convert(path, vertices=count, up=options.up)
        pictures = pictures or references(splats, scene, options.views)
        captured = linear_from_srgb(scene.colors_srgb / np.float32(255.0))
        light = capture(scene) if options.albedo else None
        truth = true_albedo(folder, scene) if options.albedo else None
        stages, given = Stages(), KnownColors(light.irradiance, light.prior) if light else KnownColors()
        baked, _, seconds = timed(lambda s=scene, g=given, t=stages: bake(s, splats, g, stages=t))
        captured_texels = bake(scene, splats) if options.albedo else baked
        shades = {
            "vertex": of_vertices(scene, captured),
            "texture": of_texture(baked.atlas, captured_texels.relit()),
        }
        albedos = {}
        if truth is not None:
            albedos = {
                "vertex": albedo_error(scene, of_vertices(scene, light.albedo), truth),
                "texture": albedo_error(scene, of_texture(baked.atlas, baked.relit()), truth),
            }
        found = psnr(scene, pictures, shades, options.pictures and options.pictures / f"{name}_{count}")
        texels = {"texels": baked.atlas.size, "unseen": baked.unseen / len(baked.albedo), "cpu_s": seconds}
        for way, figures in {"vertex": {"cpu_s": 0.0}, "texture": texels}.items():
            row = {"scene": name, "faces": len(scene.faces), "colours": way, "psnr": found[way]}
            table.add(**row, **figures, truth=albedos.get(way))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        wall = ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in stages.seconds.items())
        report.note(f"  wall: {wall}; peak so far {peak:.0f} MiB")


def references(splats, scene, count):
    """Views that no texture is made from, and the splat's pictures there."""
    views = virtual_views(splats, count, PIXELS, scene.scene_from_splat[1, :3], seed=77)[:count]
    return [(view, rasterize(splats, view)) for view in views]


def in_splat_frame(scene):
    back = np.linalg.inv(scene.scene_from_splat)
    vertices = (scene.vertices @ back[:3, :3].T + back[:3, 3]).astype(np.float32)
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(vertices, scene.faces.astype(np.uint32))
    return caster


def psnr(scene, pictures, shades, save):
    """PSNR of each way to shade over the covered pixels of all pictures: dict of dB."""
    caster, errors = in_splat_frame(scene), {name: [0.0, 0] for name in shades}
    for number, (view, rendering) in enumerate(pictures):
        covered, passes = rendering.alpha > 0.95, []
        for step in range(SAMPLES):
            shift = (step + 0.5) / SAMPLES - 0.5, (step * 0.618 + 0.3) % 1.0 - 0.5
            moved = replace(view, cx=view.cx - shift[0], cy=view.cy - shift[1])
            ways = moved.ray_directions().reshape(-1, 3)
            rays = np.hstack([np.broadcast_to(moved.center, ways.shape), ways]).astype(np.float32)
            hits = caster.cast_rays(o3d.core.Tensor(rays))
            hit = np.isfinite(hits["t_hit"].numpy())
            uv = hits["primitive_uvs"].numpy()[hit]
            passes.append((hit, hits["primitive_ids"].numpy()[hit].astype(int), weights_of(uv)))
            covered &= hit.reshape(covered.shape)
        for name, shade in shades.items():
            image = np.zeros((view.height * view.width, 3))
            for hit, faces, weights in passes:
                image[hit] += shade(faces, weights) / SAMPLES
            image = srgb_from_linear(image).reshape(view.height, view.width, 3)
            off = (image - np.clip(rendering.color, 0.0, 1.0))[covered]
            errors[name][0] += float((off**2).sum())
            errors[name][1] += off.size
            if save:
                import imageio.v3 as iio

                save.parent.mkdir(parents=True, exist_ok=True)
                both = np.hstack([bytes_from_unit(rendering.color), bytes_from_unit(image)])
                iio.imwrite(f"{save}_{name}_{number}.png", both)
    return {name: float(-10.0 * np.log10(total / count)) for name, (total, count) in errors.items()}


def weights_of(uv):
    return np.column_stack([1.0 - uv.sum(axis=1), uv])


def of_vertices(scene, colors):
    faces = scene.faces
    return lambda face, weights: np.einsum("nk,nkc->nc", weights, colors[faces[face]])


def of_texture(atlas, image):
    """Bilinear, as a graphics card reads it, linear."""
    linear, size = linear_from_srgb(image.astype(np.float32) / 255.0), atlas.size

    def shade(face, weights):
        place = np.einsum("nk,nkc->nc", weights, atlas.uv[atlas.faces[face]].astype(float)) * size - 0.5
        low = np.floor(place).astype(int)
        return _bilinear(linear, np.clip(low, 0, size - 2), np.clip(place - low, 0, 1))

    return shade


def _bilinear(image, low, part):
    x, y = part[:, :1], part[:, 1:]
    (column, row) = low.T
    top = image[row, column] * (1 - x) + image[row, column + 1] * x
    return top * (1 - y) + (image[row + 1, column] * (1 - x) + image[row + 1, column + 1] * x) * y


def capture(scene):
    """The Estimate of the light of the capture."""
    from relight.albedo import estimate
    from relight.transfer.occluder import Occluder

    occluder = Occluder(scene.vertices, scene.normals, scene.faces)
    return estimate(occluder, linear_from_srgb(scene.colors_srgb / np.float32(255.0)))


def true_albedo(folder, scene):
    """Points of the true mesh in the scene frame and their albedo, or None."""
    for name, turn in (("truth.ply", np.eye(4)), ("gt_mesh.ply", scene.scene_from_splat)):
        if folder.is_dir() and (folder / name).exists():
            vertex = ply_vertices(folder / name)
            points = np.stack([vertex[axis] for axis in "xyz"], axis=1)
            albedo = np.stack([vertex[f"albedo_{color}"] for color in "rgb"], axis=1)
            return points @ turn[:3, :3].T + turn[:3, 3], albedo
    return None


def albedo_error(scene, shade, truth):
    points, albedo = truth
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(scene.vertices, scene.faces.astype(np.uint32))
    near = caster.compute_closest_points(o3d.core.Tensor(points.astype(np.float32)))
    found = shade(near["primitive_ids"].numpy().astype(int), weights_of(near["primitive_uvs"].numpy()))
    gain = (found * albedo).sum(axis=0) / (found**2).sum(axis=0)
    return float(np.linalg.norm(gain * found - albedo) / np.linalg.norm(albedo))
