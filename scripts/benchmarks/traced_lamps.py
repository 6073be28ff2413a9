"""Placed lamps against Mitsuba: light of one lamp, bounces included, on 20 small scenes.

Five kinds of scene, four of lamp; the same mesh, albedo and lamp for both. A relight plans its rays for --tolerance.
The error is the relative L2 norm of what --probes vertices send out, against paths of up to ten bounces; noise is that
of the paths, by halves. Mitsuba needs an LLVM that it can use, as `scripts/bench bounces --help` says.
"""

from itertools import islice, product

import numpy as np

from benchmarks.bounces import PathTracer
from benchmarks.harness import relative_error, timed
from benchmarks.shapes import Shape, shape
from relight import LightingOptions, RelightRequest
from relight.jobs.job import Job
from relight.lamps.shapes import RectangleLamp, SphereLamp, SpotLamp, TubeLamp
from scenes.places import build_place

DIRECT_PART = 8  # of the lamp to one of paths: samples of a tube are noisy, and cheap

QUICK = ["--vertices", "1500", "--scenes", "1", "--probes", "40", "--samples", "16"]

OBJECTS, PLACES = ("tabletop", "room"), ("closed-box", "one-window", "lounge")

LAMPS = ("sphere", "spot", "panel", "tube")


def arguments(parser):
    parser.add_argument("--scenes", type=int, default=20, help="how many, of five kinds, each with four lamps")
    parser.add_argument("--vertices", type=int, default=100_000, help="of a scene, about")
    parser.add_argument("--tolerance", type=float, default=0.03)
    parser.add_argument("--probes", type=int, default=800, help="vertices at which light is compared")
    parser.add_argument(
        "--samples", type=int, default=4096, help="paths for each of those, and eight times as many of the lamp"
    )


def run(options, report):
    import mitsuba

    mitsuba.set_variant("llvm_ad_rgb")
    columns = {"rays": "d", "error": ".4f", "noise": ".4f", "brightness": ".3f", "seconds": ".2f"}
    title = f"light of one lamp, tolerance {options.tolerance:g}"
    table, within = report.table(title, scene="<10", lamp="<6", vertices="d", **columns), 0
    kinds = islice(product((*OBJECTS, *PLACES), LAMPS), options.scenes)
    for seed, (kind, lamp) in enumerate(kinds):
        row = compared(kind, lamp, seed, options)
        within += row["error"] <= options.tolerance
        table.add(scene=kind, lamp=lamp, **row)
    report.note(f"within {options.tolerance:g}: {within} of {options.scenes}")


def compared(kind, kind_of_lamp, seed, options):
    """Errors of the light of a lamp of one kind in a scene of another."""
    rng = np.random.default_rng(seed)
    mesh, at = scene_and_place(kind, seed, options.vertices)
    lamp = lamp_of(kind_of_lamp, at, float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))), rng)
    lighting = LightingOptions(captured=0.0, placed=(lamp,), tolerance=options.tolerance)
    job = Job(RelightRequest(mesh.scene, "captured", lighting, albedo=mesh.albedo, caching="none", formats=("npy",)))
    shaded, seconds, _ = timed(lambda: next(iter(job.shaded())))
    tracer = PathTracer(mesh, {"lamp": of_mitsuba(lamp)}, mesh.occluder)
    probes = np.sort(rng.choice(len(mesh.vertices), min(options.probes, len(mesh.vertices)), replace=False))
    halves = []
    for half in (1, 2):
        direct = tracer.direct(probes, DIRECT_PART * options.samples // 2, half)
        halves.append(mesh.albedo[probes] * (direct + tracer.indirect(probes, options.samples // 2, 2 + half)))
    true, found = (halves[0] + halves[1]) / 2, shaded.shading.radiance[probes]
    light = job.mix.lamp_light
    return {
        "vertices": len(mesh.vertices),
        "rays": 0 if light is None else light.plan.rays,
        "error": relative_error(found, true),
        "noise": relative_error(halves[0], halves[1], 2 * true),
        "brightness": float(found.sum() / true.sum()),
        "seconds": seconds,
    }


def scene_and_place(kind, seed, vertices):
    """A Shape, and a place (3,) in the open where a lamp can hang."""
    if kind in OBJECTS:
        mesh = shape(kind, vertices)
        low, high = mesh.vertices.min(axis=0).astype(float), mesh.vertices.max(axis=0).astype(float)
        return mesh, (low + high) / 2 + np.array([0.05, 0.7, 0.02]) * (high - low)
    place = build_place(kind, seed, vertices)
    eyes = np.asarray(place.walk(np.linspace(0.0, 1.0, 8, endpoint=False))[0], np.float64)
    mesh = Shape(kind, place.vertices, place.normals, place.faces, np.asarray(place.albedo_linear, np.float32))
    return mesh, eyes[seed % len(eyes)]


def lamp_of(kind, at, size, rng):
    """A lamp at a place (3,) in a scene of some size, turned at random."""
    place, red = tuple(map(float, at)), tuple(float(each) for each in 40.0 * rng.uniform(0.3, 1.0, 3))
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along = 0.03 * size * np.array([np.cos(angle), 0.0, np.sin(angle)])
    across = 0.02 * size * np.array([-np.sin(angle), 0.0, np.cos(angle)])
    if kind == "sphere":
        return SphereLamp(place, 0.01 * size, red)
    if kind == "spot":
        below = (place[0] + 0.3 * float(along[0]), place[1] - 0.1 * size, place[2])
        return SpotLamp(place, below, tuple(0.01 * size**2 * each for each in red), cutoff_deg=50.0, beam_deg=35.0)
    if kind == "panel":  # which faces down: u x v
        return RectangleLamp(place, tuple(map(float, along)), tuple(map(float, across)), red)
    return TubeLamp(place, tuple(map(float, at + 2.0 * along)), 0.002 * size, red)


def of_mitsuba(lamp):
    """The same lamp as Mitsuba's load_dict takes it; what glows reflects nothing."""
    import mitsuba as mi

    turn = mi.ScalarTransform4f
    if isinstance(lamp, SpotLamp):
        pose = turn().look_at(origin=list(lamp.position), target=list(lamp.target), up=[0, 0, 1])
        intensity = {"type": "rgb", "value": list(lamp.intensity)}
        angles = {"cutoff_angle": lamp.cutoff_deg, "beam_width": lamp.beam_deg}
        return {"type": "spot", "to_world": pose, "intensity": intensity, **angles}
    if isinstance(lamp, SphereLamp):
        body = {"type": "sphere", "center": list(lamp.position), "radius": lamp.radius}
    elif isinstance(lamp, RectangleLamp):
        u, v = np.array(lamp.edge_u) / 2, np.array(lamp.edge_v) / 2
        matrix = np.eye(4)
        matrix[:3] = np.stack([u, v, np.cross(u, v) / np.linalg.norm(np.cross(u, v)), lamp.center], axis=1)
        body = {"type": "rectangle", "to_world": turn(matrix)}
    else:
        body = {"type": "cylinder", "p0": list(lamp.start), "p1": list(lamp.end), "radius": lamp.radius}
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    glow = {"type": "area", "radiance": {"type": "rgb", "value": list(lamp.radiance)}}
    return {**body, "bsdf": black, "emitter": glow}
