"""The files of generated places and glossy tables: the capture, and the truth beside it."""

import json

import numpy as np

from splat2mesh.base.outputs import staged_folder
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.splats.formats import write_inria_ply

from .cameras import SCENE_FROM_SPLAT, capture_views, seen_faces, write_colmap, write_inria_cameras
from .capture import capture, seen_distance
from .ceramics import ceramics
from .highlights import glossy_splats
from .light import bake
from .photograph import photograph
from .places import build_place
from .radiosity import light
from .sky import capture_sky

VERTICES, TEST_VIEWS, TEST_WIDTH = 60_000, 8, 256
"""Defaults for a place; the pictures of the truth under each light, taken from some of the capture's own views."""


def write_place(options):
    """Generate the place of parsed options into a folder; returns summary lines and facts, as `console.run` wants.

    point_cloud.ply, cameras.json and sparse/0 are the output of a training (y down); truth.ply and environment.exr are
    the hidden truth. Under every light LIGHT (the capture's is named capture): truth_LIGHT.npz with the exposed
    linear radiance of the vertices (V, 3) and of the splats, their colours (N, 3) in sRGB, and photographs.
    """
    environment = capture_sky(options.env)
    lights = {name: capture_sky(name) for name in options.relit}
    place = build_place(options.kind, options.seed, options.vertices or VERTICES)
    views = capture_views(place, options.views)
    lighting = light(place, environment)
    made = capture(place, lighting, views, options.splats, options.seed, options.degree)
    seen = np.zeros(len(place.vertices), bool)
    seen[place.faces[np.isfinite(seen_distance(place, lighting.caster, views))]] = True
    facts = {
        "kind": place.kind,
        "seed": place.seed,
        "environment": options.env,
        "exposure": made.exposure,
        "splats": len(made.splats),
        "vertices": len(place.vertices),
        "faces": len(place.faces),
        "leaves": len(place.leaves),
        "lamps": bool(place.emitted.any()),
        "views": len(views),
        "lights": ["capture", *(other.name for other in lights.values())],
        "lamps_factor": options.lamps,
        "bounds": [place.vertices.min(axis=0).tolist(), place.vertices.max(axis=0).tolist()],
        "scene_from_splat": SCENE_FROM_SPLAT.tolist(),
    }
    with staged_folder(options.out, options.overwrite) as folder:
        write_inria_ply(folder / "point_cloud" / "iteration_30000" / "point_cloud.ply", made.splats)
        write_truth_ply(folder / "truth.ply", place, made.exposure * lighting.radiance(), seen)
        write_colmap(folder / "sparse" / "0", views)
        write_inria_cameras(folder / "cameras.json", views)
        write_exr(folder / "environment.exr", environment)
        np.savez_compressed(
            folder / "truth_scene.npz",
            emitted=place.emitted,
            volume=place.volume,
            splat_region=made.region,
            splat_albedo=made.albedo(place),
        )
        if lights:
            _write_truth(folder / "truth_capture.npz", lighting, made, views)
        for other in lights.values():
            _write_truth(folder / f"truth_{other.name}.npz", light(place, other, options.lamps), made, views)
        (folder / "truth.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    summary = f"{options.out}: {facts['splats']} splats, {facts['vertices']} vertices, {facts['views']} views"
    return [summary], facts


def write_ceramics(options):
    """Generate the glossy table of parsed options into a folder; returns summary lines and facts.

    splat.ply and sparse/0 are the output of a training (y down); truth.ply, environment.exr and truth_gloss.npz, with
    the reflectance (V, 3), alpha (V,) and metal (V,) of the vertices, are the hidden truth. truth_LIGHT.ply: the same
    Gaussians, trained under another light, whose exposure is in truth.json.
    """
    environments = [capture_sky(name) for name in (options.env, *options.relit)]
    truth = ceramics(options.seed, options.vertices or 20_000, not options.matte)
    views = capture_views(truth, options.views)
    faces = seen_faces(truth, views)
    splats, factors = glossy_splats(truth, environments, views, options.splats, options.seed, faces)
    seen = np.zeros(len(truth.vertices), bool)
    seen[truth.faces[faces]] = True
    facts = {
        "kind": truth.kind,
        "seed": truth.seed,
        "environment": options.env,
        "exposure": float(factors[0]),
        "splats": len(splats[0]),
        "vertices": len(truth.vertices),
        "faces": len(truth.faces),
        "glossy": bool(truth.glossy.any()),
        "views": len(views),
        "lights": {light.name: float(factor) for light, factor in zip(environments[1:], factors[1:], strict=True)},
        "bounds": [truth.vertices.min(axis=0).tolist(), truth.vertices.max(axis=0).tolist()],
        "scene_from_splat": SCENE_FROM_SPLAT.tolist(),
    }
    with staged_folder(options.out, options.overwrite) as folder:
        write_inria_ply(folder / "splat.ply", splats[0])
        write_truth_ply(folder / "truth.ply", truth, factors[0] * bake(truth, environments[0]), seen)
        write_colmap(folder / "sparse" / "0", views)
        write_exr(folder / "environment.exr", environments[0])
        gloss = {"reflectance": truth.reflectance, "alpha": truth.alpha, "metal": truth.metal}
        np.savez_compressed(folder / "truth_gloss.npz", **gloss)
        for environment, relit in zip(environments[1:], splats[1:], strict=True):
            write_inria_ply(folder / f"truth_{environment.name}.ply", relit)
        (folder / "truth.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    summary = f"{options.out}: {facts['splats']} splats, {facts['vertices']} vertices, {facts['views']} views"
    return [summary], facts


def write_exr(path, environment):
    """Write an environment as an OpenEXR file, canonical lat-long, its rotation left out."""
    import OpenEXR

    pixels = np.ascontiguousarray(environment.radiance, np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": pixels}).write(str(path))


def _write_truth(path, lighting, made, views):
    chosen = range(1, len(views), max(1, len(views) // TEST_VIEWS))[:TEST_VIEWS]
    pictures = [photograph(lighting, views[number].resized(TEST_WIDTH)) for number in chosen]
    np.savez_compressed(
        path,
        vertex_radiance=(made.exposure * lighting.radiance()).astype(np.float16),
        splat_sh=made.lit(lighting).sh,
        pictures=np.stack([made.exposure * picture for picture, _ in pictures]).astype(np.float16),
        solid=np.stack([solid for _, solid in pictures]),
        view=np.array(chosen),
    )


def write_truth_ply(path, truth, radiance, seen):
    """Binary PLY, scene frame: position, normal, linear albedo, baked sRGB colour, part, seen (0 or 1)."""
    layout = [("position", "<f4", 3), ("normal", "<f4", 3), ("albedo", "<f4", 3), ("color", "u1", 3)]
    vertex = np.zeros(len(truth.vertices), [*layout, ("part", "u1"), ("seen", "u1")])
    vertex["position"], vertex["normal"], vertex["albedo"] = (
        truth.vertices,
        truth.normals,
        truth.albedo_linear,
    )
    vertex["color"] = bytes_from_unit(srgb_from_linear(radiance))
    vertex["part"], vertex["seen"] = truth.part, seen
    face = np.zeros(len(truth.faces), [("count", "u1"), ("indices", "<i4", 3)])
    face["count"], face["indices"] = 3, truth.faces
    floats = ["x", "y", "z", "nx", "ny", "nz", "albedo_r", "albedo_g", "albedo_b"]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}"]
    header += [f"property float {name}" for name in floats]
    header += [f"property uchar {name}" for name in ("red", "green", "blue", "part", "seen")]
    header += [f"element face {len(face)}", "property list uchar int vertex_indices", "end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(header).encode("ascii"))
        vertex.tofile(file)
        face.tofile(file)
