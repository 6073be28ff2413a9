"""Speed of the rasteriser: views a second on a splat file or a generated surface, against its NumPy twin."""

import sys
from pathlib import Path

import numpy as np

from benchmarks.harness import medians, timed
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.splats import Splats

sys.path.insert(0, str(Path(__file__).parents[2] / "tests/support"))

from rasterize_reference import rasterize_reference

VIEWS = 8
SMALL_SPLATS, SMALL_SIZE = 500, 64
QUICK = ["--splats", "5000", "--size", "128", "--repeats", "1"]


def arguments(parser):
    parser.add_argument("file", nargs="?", help="splat file; without it: a random bumpy sphere")
    parser.add_argument("--splats", type=int, default=150_000, help="size of the sphere (default %(default)s)")
    parser.add_argument("--size", type=int, default=512, help="image side in pixels (default %(default)s)")
    parser.add_argument("--repeats", type=int, default=5, help="rounds over the views (default %(default)s)")


def run(options, report):
    splats = read_splats(options.file) if options.file else bumpy_sphere(options.splats)
    views = views_around(splats, options.size)
    covered, first, _ = timed(lambda: [float((rasterize(splats, view).alpha > 0.5).mean()) for view in views])
    runs = [timed(lambda v=view: rasterize(splats, v)) for _ in range(options.repeats) for view in views]
    report.note(f"{len(splats)} splats of degree {splats.degree}, {VIEWS} views of {options.size} x {options.size}")
    report.note(f"median coverage {np.median(covered):.0%}; first round with compilation {first:.1f} s")
    table = report.table(renderer="<24", splats=",", size="d", ms=".2f", best_ms=".2f", cpu_ms=".2f", views_per_s=".1f")

    def add(renderer, count, size, runs):
        wall, cpu = (1e3 * np.array([getattr(run, key) for run in runs]) for key in ("wall", "cpu"))
        row = {"renderer": renderer, "splats": count, "size": size, "ms": np.median(wall), "best_ms": wall.min()}
        table.add(**row, cpu_ms=np.median(cpu), views_per_s=1e3 / np.median(wall))

    add("rasterize", len(splats), options.size, runs)
    small = bumpy_sphere(SMALL_SPLATS)
    view = views_around(small, SMALL_SIZE)[0]
    fast = medians({"rasterize": lambda: rasterize(small, view)}, 20)["rasterize"]
    slow = medians({"reference": lambda: rasterize_reference(small, view)}, 3)["reference"]
    add("rasterize", SMALL_SPLATS, SMALL_SIZE, [fast])
    add("its NumPy reference", SMALL_SPLATS, SMALL_SIZE, [slow])


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
