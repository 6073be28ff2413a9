"""Interreflection against Mitsuba 3's path tracer, and its time.

The albedo is the mesh's colours; --faces decimates the mesh first, for both. Without mitsuba only times are printed;
mitsuba needs an LLVM that it can use: DRJIT_LIBLLVM_PATH names one (22 works; 14 and 15 abort). Errors are relative L2
norms over 400 vertices chosen at random.
"""

import tempfile
from dataclasses import replace
from importlib.util import find_spec

import numpy as np

from benchmarks.harness import medians, relative_error, timed
from benchmarks.shapes import MADE_VERTICES, Shape, shape
from relight import Environment
from relight.transfer import DEFAULT_BANDS, DEFAULT_RAYS, sampling
from relight.transfer.bounce_rows import FINENESS
from relight.transfer.bounces import (
    Interreflection,
    transfer_with_bounces,
    visible_fraction,
    with_bounces,
)
from relight.transfer.occluder import BATCH_RAYS
from relight.transfer.settings import BOUNCE_RAYS
from relight.transfer.visibility import raytraced_scene

PROBES = 400  # vertices that are compared
DIRECT_SAMPLES = 2**15  # of the light, for each of them: 0.5% noise
PATHS = 2**14  # per vertex, twice: the difference of the halves gives the noise
INPUT_SAMPLES = 2**8  # of the light, for every vertex, where exact direct light is to bounce
CHUNK = 2**21  # samples that Mitsuba works on at once
QUICK = ["--vertices", "2000", "--rays", "16", "--large", "0", "--no-tracer"]


def arguments(parser):
    parser.add_argument("mesh", nargs="?", default="tabletop")
    parser.add_argument("--env", default="noon", metavar="FILE|NAME")
    parser.add_argument("--faces", type=int, help="decimate the mesh to this number")
    parser.add_argument("--vertices", type=int, default=MADE_VERTICES, help="of a generated mesh")
    parser.add_argument("--rays", type=int, nargs="+", default=[16, 32, 64, 128, 256, 512])
    parser.add_argument("--large", type=int, default=500_000, help="vertices of a scene that is only timed")
    parser.add_argument("--no-tracer", action="store_true", help="times only, as without mitsuba")
    parser.add_argument("--light-samples", type=int, default=INPUT_SAMPLES, help="of the light, for every vertex")
    parser.add_argument("--paths", type=int, default=PATHS, help="for each of the vertices that are compared")


def run(options, report):
    mesh, light = shape(options.mesh, options.vertices), Environment.load(options.env)
    mesh = decimated(mesh, options.faces) if options.faces else mesh
    if mesh.albedo is None:
        mesh = replace(mesh, albedo=np.ones_like(mesh.vertices))
    report.note(f"{len(mesh.vertices):,} vertices, {len(mesh.faces):,} faces under {light.name}")
    if options.no_tracer or find_spec("mitsuba") is None:
        report.note("without mitsuba: times only")
    else:
        import mitsuba

        mitsuba.set_variant("llvm_ad_rgb")
        errors(mesh, light, options, report)
    times(mesh, report)
    if options.large:
        times(shape("tabletop", options.large), report)


def decimated(shape, count):
    """The shape in `count` faces, with the albedo of the nearest old vertex."""
    import fast_simplification
    import open3d as o3d
    from scipy.spatial import cKDTree

    vertices, faces = fast_simplification.simplify(shape.vertices, shape.faces, target_count=count)
    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(faces))
    mesh.remove_unreferenced_vertices()
    vertices, faces = np.asarray(mesh.vertices, np.float32), np.asarray(mesh.triangles, np.int32)
    mesh.compute_vertex_normals()
    _, nearest = cKDTree(shape.vertices).query(vertices)
    albedo = None if shape.albedo is None else shape.albedo[nearest]
    return Shape(shape.name, vertices, np.asarray(mesh.vertex_normals, np.float32), faces, albedo)


def errors(mesh, light, options, report):
    """The remaining difference to Mitsuba by number of rays and of bounces."""
    occluder, albedo = mesh.occluder, mesh.albedo
    transfer = raytraced_scene(occluder, DEFAULT_BANDS, DEFAULT_RAYS)
    own_direct = np.maximum(transfer @ light.sh(DEFAULT_BANDS).astype(np.float32), 0)

    tracer = PathTracer(mesh, light, occluder)
    everywhere = tracer.direct(np.arange(len(albedo)), options.light_samples, 1)
    probes = np.random.default_rng(0).choice(len(albedo), min(PROBES, len(albedo)), replace=False)
    direct = albedo[probes] * tracer.direct(probes, DIRECT_SAMPLES, 2)
    halves, seconds, _ = timed(
        lambda: [albedo[probes] * tracer.indirect(probes, options.paths, seed) for seed in (3, 4)]
    )
    bounced = (halves[0] + halves[1]) / 2
    full = direct + bounced

    def percent(found, expected, of=None):
        return 100.0 * relative_error(found, expected, of)

    noise = percent(bounced, halves[0], full)
    report.note(f"path tracer: {seconds:.1f} s for {len(probes)} vertices, noise {noise:.2f}%")
    truncated = (
        f"direct light by itself, {DEFAULT_BANDS} bands: {percent(albedo[probes] * own_direct[probes], direct):.1f}%"
    )
    report.note(f"left out without bounces {percent(direct, full):.1f}%; {truncated}")

    names = "rows_scaled", "as_traced", "exact_direct_bounced", "in_all"
    table = report.table("error of the bounces, in % of all light", rays="d", **dict.fromkeys(names, ".2f"))
    for rays in options.rays:
        found = []
        for visible, direct_light in ((True, own_direct), (False, own_direct), (True, everywhere)):
            matrix = Interreflection(occluder, rays, visible=visible_fraction(transfer) if visible else None)
            radiance, _ = with_bounces(direct_light, albedo, matrix)
            found.append(percent((radiance - albedo * direct_light)[probes], bounced, full))
            if visible and direct_light is own_direct:
                whole = percent(radiance[probes], full)
        table.add(rays=rays, **dict(zip(names, (*found, whole), strict=True)))

    matrix = Interreflection(occluder, visible=visible_fraction(transfer))
    title = f"{BOUNCE_RAYS} rays: error of the bounces and contribution in %, seconds of all so far"
    table = report.table(title, bounces="d", error=".2f", contribution=".2f", seconds=".4f")
    for count in range(9):
        work = {"tolerance": 0.0, "max_bounces": count}
        (radiance, given), seconds, _ = timed(lambda w=work: with_bounces(own_direct, albedo, matrix, **w))
        off = percent((radiance - albedo * own_direct)[probes], bounced, full)
        table.add(bounces=count, error=off, contribution=100.0 * given[-1] if given else 100.0, seconds=seconds)


def times(mesh, report):
    """How long it takes, beside bare Embree on the same rays and SciPy on the same matrix: medians of three."""
    import scipy.sparse

    albedo, occluder = np.asarray(mesh.albedo, np.float32), mesh.occluder
    Interreflection(occluder, 4).bounce(albedo)  # compiles, and builds the tree
    made = medians({"cast_rays": lambda: cast(occluder), "matrix": lambda: Interreflection(occluder)}, 3)
    matrix = made["matrix"].result
    parts = matrix._parts.astype(np.float32)
    weights = np.column_stack([FINENESS - parts.sum(axis=1), parts]) / FINENESS
    shape = len(albedo), len(albedo)
    plain = scipy.sparse.csr_matrix((weights.ravel(), matrix._corners.ravel(), 3 * matrix._starts), shape)
    plain.sum_duplicates()
    used = medians({"one bounce in RGB": lambda: matrix.bounce(albedo), "the same by scipy": lambda: plain @ albedo}, 3)
    size = f"{matrix.entries:,} places, {matrix.nbytes / 2**20:.0f} MiB"
    table = report.table(f"{len(albedo):,} vertices, {matrix.rays} rays: {size}", work="<20", wall_s=".4f", cpu_s=".4f")
    hit = matrix.hits.mean() / matrix.rays
    for name, (_, wall, cpu) in (made | used).items():
        table.add(work=name, wall_s=wall, cpu_s=cpu)
    report.note(f"{100 * hit:.0f}% of rays hit, {100 * matrix.back_hits:.1f}% of hits from behind")
    if len(albedo) < 10**5:
        transfer = raytraced_scene(occluder, DEFAULT_BANDS, DEFAULT_RAYS)
        (_, given), seconds, _ = timed(lambda: transfer_with_bounces(transfer, albedo, matrix))
        report.note(f"transfer of {DEFAULT_BANDS} bands through {len(given)} bounces {seconds:.2f} s")


def cast(occluder):
    azimuths = sampling.fibonacci_azimuths(BOUNCE_RAYS)
    batch = BATCH_RAYS // BOUNCE_RAYS
    buffer = np.zeros((batch, BOUNCE_RAYS, 6), np.float32)
    for start in range(0, len(occluder.origins), batch):
        part = slice(start, start + batch)
        shot = buffer[: len(occluder.origins[part])]
        sampling.shoot(occluder.origins[part], occluder.normals[part], azimuths, 0, shot)
        occluder.first_hits(shot)


def diffuse_solid(mesh, path):
    """A mesh in the colours of its albedo, written to a PLY, as Mitsuba's load_dict takes it."""
    import mitsuba as mi

    shape = mi.Mesh("scene", len(mesh.vertices), len(mesh.faces), has_vertex_normals=True)
    shape.add_attribute("vertex_color", 3, np.asarray(mesh.albedo, np.float32).ravel())
    arrays = mi.traverse(shape)
    for name, source in (("positions", "vertices"), ("normals", "normals")):
        arrays[f"vertex_{name}"] = np.asarray(getattr(mesh, source), np.float32).ravel()
    arrays["faces"] = np.asarray(mesh.faces, np.uint32).ravel()
    arrays.update()
    shape.write_ply(path)
    reflectance = {"type": "mesh_attribute", "name": "vertex_color"}
    return {"type": "ply", "filename": path, "bsdf": {"type": "diffuse", "reflectance": reflectance}}


class PathTracer:
    """Exit radiance of white vertices by Mitsuba, from cosine rays about the same normals, from the same origins.

    light: an Environment, or a dict of a scene's emitters as Mitsuba's load_dict takes them.
    """

    def __init__(self, mesh, light, occluder):
        import mitsuba as mi

        low, high = mesh.vertices.min(axis=0).astype(float), mesh.vertices.max(axis=0).astype(float)
        self.origins = occluder.origins * np.linalg.norm(high - low) + (low + high) / 2
        self.normals = occluder.normals
        with tempfile.TemporaryDirectory() as folder:
            solid = diffuse_solid(mesh, f"{folder}/mesh.ply")
            if not isinstance(light, dict):
                light = {"light": {"type": "envmap", "bitmap": mi.Bitmap(np.array(light.radiance))}}
            self._scene = mi.load_dict({"type": "scene", "solid": solid, **light})

    def indirect(self, vertices, samples, seed):
        """(N, 3) from other surfaces: paths of up to ten bounces, blind to the light behind them."""
        import mitsuba as mi

        paths = {"type": "path", "max_depth": 11, "rr_depth": 1000, "hide_emitters": True}
        integrator = mi.load_dict(paths)

        def sample(rays, normals, sampler):
            return integrator.sample(self._scene, sampler, mi.RayDifferential3f(rays))[0]

        return self._mean(vertices, samples, seed, sample)

    def direct(self, vertices, samples, seed):
        """(N, 3) from the light: samples of it by its radiance, tested for shadow."""
        import drjit as dr
        import mitsuba as mi

        def sample(rays, normals, sampler):
            at = dr.zeros(mi.SurfaceInteraction3f, dr.width(rays.o))
            at.p = rays.o
            toward, weight = self._scene.sample_emitter_direction(at, sampler.next_2d(), False)
            cosine = dr.dot(toward.d, normals)
            between = mi.Ray3f(rays.o, toward.d)
            between.maxt = (1.0 - 1e-4) * toward.dist  # a lamp does not hide itself
            hidden = (cosine <= 0) | self._scene.ray_test(between)
            return dr.select(hidden, 0, weight * cosine / np.pi)

        return self._mean(vertices, samples, seed, sample)

    def _mean(self, vertices, samples, seed, sample):
        import drjit as dr
        import mitsuba as mi

        result, step = np.zeros((len(vertices), 3)), max(1, CHUNK // samples)
        for start in range(0, len(vertices), step):
            some = vertices[start : start + step]
            owner = dr.arange(mi.UInt32, len(some) * samples) // samples
            origins, normals = (
                dr.gather(mi.Vector3f, mi.Vector3f(a[some].T.astype(np.float32)), owner)
                for a in (self.origins, self.normals)
            )
            sampler = mi.load_dict({"type": "independent"})
            sampler.seed(seed * 10**6 + start, dr.width(owner))
            local = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
            rays = mi.Ray3f(mi.Point3f(origins), mi.Frame3f(normals).to_world(local))
            values = np.array(sample(rays, normals, sampler)).T
            result[start : start + step] = values.reshape(-1, samples, 3).mean(axis=1)
        return result
