"""Error and time of ray traced transfer against the number of rays, and its speed against bare Embree on the same rays.

Relative L2 errors against a converged reference, geometric means over the meshes:
shared        one set of directions over the sphere for all vertices, as many above the horizon as there are rays
plain         cosine-distributed Fibonacci sets of each vertex, the mean over the visible rays
constant      ... with the unoccluded transfer as control variate
linear        ... with the visibility fitted by a + b . d: `raytraced`
scene         ... averaged over neighbours: `raytraced_scene`; worst: the largest error of a mesh against its `linear`
Then the variance that `filtering` expects of a coefficient of `linear` below degree 3. Times are processor microseconds
per vertex; `shared` counts its occlusion queries only.
"""

import numpy as np

from benchmarks.harness import geometric_mean, relative_error, timed
from benchmarks.shapes import MADE_VERTICES, shape
from relight.sh import harmonics
from relight.transfer import sampling
from relight.transfer.analytic import analytic
from relight.transfer.filtering import NOISE_POWER
from relight.transfer.visibility import raytraced_scene
from scenes.plain_rays import raytraced
from splat2mesh.base import sphere

EVERY = slice(None)
METHODS = "shared", "plain", "constant", "linear", "scene"
BATCH = 2**18  # rays whose harmonics NumPy holds at once: 100 MiB at 10 bands
QUICK = ["bumps", "--vertices", "2000", "--bands", "3", "--rays", "8", "--reference", "512"]
PLOT = {"x": "us_scene", "y": "scene", "by": ("bands",)}


def arguments(parser):
    parser.add_argument("meshes", nargs="*", default=["bumps", "tori"])
    parser.add_argument("--bands", type=int, nargs="+", default=[3, 5, 10])
    parser.add_argument("--rays", type=int, nargs="+", default=[8, 16, 32, 64, 128, 256])
    parser.add_argument("--reference", type=int, default=4096, help="rays of the reference")
    parser.add_argument("--vertices", type=int, default=MADE_VERTICES, help="of generated meshes")


def run(options, report):
    meshes = [shape(name, options.vertices) for name in options.meshes]
    most = max(options.bands)
    errors, seconds, noise, count = {}, {}, {}, 0
    for mesh in meshes:
        occluder = mesh.occluder
        count += len(occluder.origins)
        reference = raytraced(occluder, EVERY, most, options.reference, seed=2**32 + 1)
        report.note(f"{mesh.name}: {len(reference):,} vertices")
        for rays in options.rays:
            raytraced_scene(occluder, 1, 8)  # compiled, and the tree built
            plain, constant = own_sets(occluder, most, rays)
            for bands in options.bands:
                linear, _, linear_s = timed(lambda o=occluder, b=bands, r=rays: raytraced(o, EVERY, b, r))
                scene, _, scene_s = timed(lambda o=occluder, b=bands, r=rays: raytraced_scene(o, b, r))
                results = {
                    "shared": shared(occluder, bands, rays),
                    "plain": (plain[:, : bands**2], np.nan),
                    "constant": (constant[:, : bands**2], np.nan),
                    "linear": (linear, linear_s),
                    "scene": (scene, scene_s),
                }
                if bands >= 3:
                    fraction = np.clip(reference[:, 0] * np.sqrt(4 * np.pi), 0, 1)
                    square = ((linear[:, :9] - reference[:, :9]) ** 2).sum() / 9
                    noise.setdefault(rays, {})[mesh.name] = square / (fraction * (1 - fraction)).sum()
                for method, (transfer, spent) in results.items():
                    error = relative_error(transfer, reference[:, : bands**2])
                    errors.setdefault((bands, rays, method), []).append(error)
                    seconds[bands, rays, method] = seconds.get((bands, rays, method), 0.0) + spent
    timed_methods = "shared", "linear", "scene"
    columns = {"bands": "d", "rays": "d"} | dict.fromkeys(METHODS, ".4f") | {"worst": ".2f"}
    table = report.table("errors, microseconds", **columns, **{f"us_{method}": ".2f" for method in timed_methods})
    for bands in options.bands:
        for rays in options.rays:
            row = {method: geometric_mean(errors[bands, rays, method]) for method in METHODS}
            row["worst"] = float(max(np.divide(errors[bands, rays, "scene"], errors[bands, rays, "linear"])))
            row |= {f"us_{method}": 1e6 * seconds[bands, rays, method] / count for method in timed_methods}
            table.add(bands=bands, rays=rays, **row)
    for rays, of_mesh in noise.items():
        scaled = np.array(list(of_mesh.values())) * float(rays) ** -NOISE_POWER
        span = f"{scaled.min():.4f} to {scaled.max():.4f}"
        report.note(f"variance at {rays} rays: {scaled.mean():.4f} ({span}) R^{NOISE_POWER} f (1 - f)")


def shared(occluder, bands, rays):
    """Transfer from one Fibonacci set of 2 R directions over the sphere, and the seconds of its queries."""
    count = 2 * rays
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = 2.0 * np.pi * sphere.GOLDEN_TURN * np.arange(count)
    flat = np.sqrt(1.0 - z * z)
    directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1).astype(np.float32)
    basis = harmonics.evaluate(directions, bands) * np.float32(4.0 / count)
    transfer, seconds = np.zeros((len(occluder.origins), bands**2), np.float32), 0.0
    for start in range(0, len(transfer), 2**20 // count):
        part = slice(start, start + 2**20 // count)
        cosine = occluder.normals[part] @ directions.T
        vertex, direction = np.nonzero(cosine > 0)
        shot = np.concatenate([occluder.origins[part][vertex], directions[direction]], axis=1)
        occluded, _, spent = timed(lambda shot=shot: occluder.occluded(shot))
        cosine[vertex[occluded], direction[occluded]] = 0.0
        transfer[part] = np.maximum(cosine, 0.0) @ basis
        seconds += spent
    return transfer, seconds


def own_sets(occluder, bands, rays):
    """Transfer from own rays, plain and with the constant control variate, written out."""
    unshadowed = analytic(occluder.normals, bands)
    plain, constant = np.zeros_like(unshadowed), np.zeros_like(unshadowed)
    for part, shot in shots(occluder, rays, BATCH // rays):
        visible = ~occluder.occluded(shot)
        basis = harmonics.evaluate(shot[..., 3:].reshape(-1, 3), bands).reshape(*visible.shape, -1)
        plain[part] = np.matmul(visible[:, None].astype(np.float32), basis)[:, 0] / rays
        share = visible.mean(axis=1, dtype=np.float32)[:, None]
        constant[part] = plain[part] + share * (unshadowed[part] - basis.mean(axis=1))
    return plain, constant


def shots(occluder, rays, size):
    """(slice, rays (n, R, 6)) of all vertices, `size` at a time."""
    azimuths = sampling.fibonacci_azimuths(rays)
    for start in range(0, len(occluder.origins), size):
        part = slice(start, start + size)
        shot = np.zeros((len(occluder.origins[part]), rays, 6), np.float32)
        sampling.shoot(occluder.origins[part], occluder.normals[part], azimuths, 0, shot)
        yield part, shot
