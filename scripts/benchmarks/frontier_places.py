"""Accuracy against time in places, by lamps and with gloss, and what `--tolerance` chooses: tables, JSON and one plot.

SCENE is a scene folder of a splat; without any, a garden, a lounge and a glossy table are generated. Up to three panels
are measured for each, with the albedo that `relight` estimates:
sky     the light of --env: bands, rays and suns, bounces, leaves as volumes
lamp    one bulb, alone: rays in half-shadows, rays of the first bounce
gloss   rays of a glossy pixel's lobe, and no gloss at all; on the relit splat
Errors are relative L2: of exit radiance over all vertices, for gloss of the colours of eight pictures. The truth is
the same code with its finest settings and another seed; how far the sky's direct light is from
`relight.transfer.reference` at 1,500 vertices is printed. Times are processor seconds of all threads over those in
which bare Embree shoots one shadow ray from every vertex. The time of a plan includes planning. Nothing that the
estimate of the captured light has traced is used, but for the bounces of lamps.
"""

import json
import subprocess
import sys
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks import frontier_plot
from benchmarks.frontier import bare_seconds, copy, seconds_of, warm_up
from benchmarks.harness import ROOT, relative_error
from relight import LightingOptions, Relighter, RelightRequest
from relight.gloss import mirrored
from relight.gloss.pixels import SurfacePixels
from relight.jobs.job import Job
from relight.jobs.results import Results
from relight.planning.lamp_plan import RayPlan
from relight.transfer.reference import reference
from relight.transfer.settings import BOUNCE_TOLERANCE, Settings
from splat2mesh import convert
from splat2mesh.render.view import View
from splat2mesh.views.viewpoints import even_directions

SAMPLES = 1500
DIRECTIONS = 16384
OTHER_SEED = 977
FINEST = Settings("raytraced", 10, 2048, 0.001, 512, 1e-5, 4096)
FINEST_LAMP, FINEST_BOUNCE, FINEST_LOBE = 1024, 2048, 64
BOUNCES, VOLUME = 64, 512  # of the grid
LAMP_RAYS, FIRST_RAYS, LOBE_RAYS = (8, 32, 128), (0, 64, 256), (1, 2, 4, 8, 16, 32)
PICTURES, SIDE = 8, 256
MATT = "shadows,sun,bounces,volume"
SHARED = "scene", "splats", "relighter", "binding", "appearance", "room", "environment", "lights", "cache"
MADE = {"garden": ["--env", "cloudy"], "lounge": [], "ceramics": ["--env", "studio"]}
QUICK = ["--panels", "lamp", "--made", "nook", "--splats", "3000", "--vertices", "4000", "--tolerances", "0.1"]


def arguments(parser):
    parser.add_argument("scenes", nargs="*", type=Path, metavar="SCENE")
    parser.add_argument("--env", default="noon", metavar="FILE|NAME", help="the new sky (default: noon)")
    parser.add_argument("--angle", type=float, default=30.0, metavar="DEG", help="turn of that sky (default: 30)")
    parser.add_argument("--panels", nargs="+", default=["sky", "lamp", "gloss"], choices=["sky", "lamp", "gloss"])
    parser.add_argument("--tolerances", nargs="+", type=float, default=[0.1, 0.05, 0.03, 0.02, 0.01], metavar="T")
    parser.add_argument("--bands", nargs="+", type=int, default=[3, 5, 8], metavar="B")
    parser.add_argument("--rays", nargs="+", type=int, default=[16, 64, 256, 1024], metavar="N")
    parser.add_argument("--made", nargs="+", default=list(MADE), metavar="KIND", help="generated scenes")
    parser.add_argument("--splats", type=int, default=40_000, help="of a generated scene")
    parser.add_argument("--vertices", type=int, default=60_000, help="of the mesh of a generated scene")
    parser.add_argument("--out", type=Path, default=Path("frontier"), metavar="FOLDER")
    parser.add_argument("--draw", type=Path, metavar="JSON", help="draw the plot of an earlier run again")


def run(options, report):
    options.out.mkdir(parents=True, exist_ok=True)
    if options.draw:
        frontier_plot.draw_panels(json.loads(options.draw.read_text()), options.out / "frontier_places.png")
        return
    warm_up()
    panels = []
    columns = {"setting": "<44", "work": ".1f", "error": ".2%", "seconds": ".2f"}
    for folder in options.scenes or [made(kind, options) for kind in options.made]:
        for name, rows in measured(Place(folder, options), report):
            table = report.table(f"{folder.name}, {name}: work in rays a vertex", **columns)
            for row in rows:
                table.add(**row)
            panels.append({"scene": folder.name, "panel": name, "rows": table.rows})
            (options.out / "frontier_places.json").write_text(json.dumps(panels) + "\n")
    frontier_plot.draw_panels(panels, options.out / "frontier_places.png")


def made(kind, options):
    """Folder of the mesh of a generated scene, made where it is missing."""
    name = f"{kind}-{options.splats // 1000}k"
    capture, folder = options.out / "scenes" / f"{name}.made", options.out / "scenes" / name
    if not folder.exists():
        words = ["--kind", kind, "--splats", str(options.splats), *MADE.get(kind, []), "--overwrite", "-q"]
        subprocess.run([sys.executable, "-m", "scenes", capture, *words], check=True, cwd=ROOT)
        source = next(path for path in capture.rglob("*.ply") if path.stem in ("point_cloud", "splat"))
        convert(source, vertices=options.vertices, texture="none").save(folder)
    return folder


def measured(place, report):
    """(name, rows) of the panels that make sense for a place."""
    panels = place.options.panels
    if "sky" in panels and not place.job.known.appearance.as_captured:
        yield f"sky {place.options.env}", place.sky(report)
    if "lamp" in panels:
        yield "lamp", place.lamp()
    if "gloss" in panels and place.glossy:
        yield "gloss", place.gloss()


class Place:
    """A scene folder, its albedo as `relight` estimates it, and the time of one bare ray from every vertex."""

    def __init__(self, folder, options):
        self.options = options
        request = RelightRequest(
            folder, options.env, LightingOptions(), angles_deg=(options.angle,), formats=("splat",)
        )
        self.job = Job(request)
        self.look, self.room = self.job.known.appearance, self.job.room
        self.albedo = self.look.albedo if self.look.room is None else self.look.room.albedo
        self.scene, self.light = self.job.known.scene, self.job.lights[0]
        self.occluder = self.job.known.relighter.occluder
        count = len(self.occluder.origins)
        self.rows = np.sort(np.random.default_rng(5).choice(count, min(SAMPLES, count), replace=False))
        self.bare = [bare_seconds(self.occluder) for _ in range(3)]

    def row(self, setting, seconds, error, plan=False):
        """A row of a panel; its unit of work is measured right after it."""
        self.bare = [*self.bare[-2:], bare_seconds(self.occluder)]
        work = seconds / float(np.median(self.bare))
        return {"setting": setting, "work": work, "error": error, "seconds": seconds, "plan": plan}

    # sky

    def sky(self, report):
        """Rows of the light of a sky: a grid of settings, then plans."""
        scene, leaves = self.scene, Relighter(self.scene).precomputed.foliage
        relighter = Relighter(scene, seed=OTHER_SEED)
        finest = FINEST if leaves is not None else FINEST._replace(volume=0)
        truth = relighter.shading(copy(self.light), self.albedo, finest).radiance
        direct = relighter.direct(copy(self.light), finest)[0][self.rows]
        off = relative_error(direct, reference(self.occluder, self.rows, self.light, DIRECTIONS, leaves))
        bare = 1e9 * float(np.median(self.bare)) / scene.vertex_count
        report.note(f"\n{scene.vertex_count} vertices, {bare:.0f} ns a bare ray")
        report.note(f"direct light of the truth: {off:.2%} from the reference")
        rest = Settings("raytraced", 3, 16, 0.0, BOUNCES, BOUNCE_TOLERANCE, VOLUME if leaves is not None else 0)
        grid = [Settings("analytic", 3)]
        for bands in self.options.bands:
            for rays in self.options.rays:
                one = rest._replace(bands=bands, rays=rays)
                grid += [one._replace(bounce_rays=0, bounce_tolerance=0.0), one, one._replace(sun_tolerance=0.006)]
        for settings in grid:
            fresh = Relighter(scene)
            _ = fresh.occluder  # its tree is not counted, here or in plans
            work = seconds_of(lambda f=fresh, s=settings: f.shading(copy(self.light), self.albedo, s))
            yield self.row(str(settings), work[0], relative_error(work[1].radiance, truth))
        for tolerance in self.options.tolerances:
            fresh = Relighter(scene, tolerance=tolerance)
            _ = fresh.occluder
            seconds, shading = seconds_of(lambda f=fresh: f.shading(copy(self.light), self.albedo))
            name = f"{tolerance:g}: {shading.settings}"
            yield self.row(name, seconds, relative_error(shading.radiance, truth), plan=True)

    # lamp

    def bulb(self, tolerance=0.01, seed=0):
        """A LampLight of one bulb where the capture stood, or above an object."""
        eyes = np.asarray(self.scene.capture.get("eyes", ()), np.float64).reshape(-1, 3)
        low, high = self.scene.vertices.min(axis=0), self.scene.vertices.max(axis=0)
        at = np.median(eyes, axis=0) if len(eyes) else (low + high) / 2 + [0.1, 0.9, 0.2] * (high - low)
        at = np.linalg.inv(self.scene.scene_from_splat) @ [*at, 1.0]
        lamp = ",".join(f"{value:.4f}" for value in at[:3])
        options = LightingOptions(placed=(lamp,), captured=0.0, tolerance=tolerance, seed=seed)
        request = RelightRequest(self.scene, "captured", options, formats=("npy",), caching="none")
        job = Job(request)
        vars(job).update(appearance=self.look, room=self.room)
        light = job.mix.lamp_light
        light.prepare()  # the bounces that the estimate of the captured light has traced
        return light

    def lamp(self):
        """Rows of the light of a bulb: rays in half-shadows by those of the first bounce, then plans."""
        truth = self.with_rays(self.bulb(seed=OTHER_SEED), FINEST_LAMP, FINEST_BOUNCE)[1]
        for rays in LAMP_RAYS:
            for first in FIRST_RAYS:
                seconds, found = self.with_rays(self.bulb(), rays, first)
                yield self.row(f"{rays} rays, first bounce {first}", seconds, relative_error(found, truth))
        for tolerance in self.options.tolerances:
            light = self.bulb(tolerance)
            seconds, placed = seconds_of(lambda one=light: one.placed)
            name = f"{tolerance:g}: {light.plan.rays} rays, first bounce {light.bounce_plan.rays}"
            yield self.row(name, seconds, relative_error(placed.radiance, truth), plan=True)

    def with_rays(self, light, rays, first):
        """(seconds, exit radiance of all vertices) with so many rays, none planned."""
        light.plan = RayPlan(rays, 0.0, 0.0, [], share=1.0)
        light.bounce_plan = RayPlan(first, 0.0, 0.0, [])
        seconds, placed = seconds_of(lambda: light.placed)
        return seconds, placed.radiance

    # gloss

    @property
    def glossy(self):
        """Whether `relight` finds gloss on it."""
        return self.job.known.gloss is not None and self.job.known.gloss.of(self.look) is not None

    def gloss(self):
        """Rows of the relit splat's pictures: without gloss, then by rays of each pixel's lobe, whose default the plan
        has."""
        shaded, usual = next(iter(self.job.shaded())), mirrored.RAYS
        matt = self.relit(shaded, RelightRequest.of(self.job.request, effects=MATT), usual)
        truth = self.relit(shaded, self.job.request, FINEST_LOBE)[1]
        yield self.row("no gloss", matt[0], relative_error(matt[1], truth))
        for rays in LOBE_RAYS:
            seconds, found = self.relit(shaded, self.job.request, rays)
            yield self.row(f"{rays} rays a pixel", seconds, relative_error(found, truth), plan=rays == usual)

    def relit(self, shaded, request, rays):
        """(seconds, drawn colours of the views) of the relit splat, with so many rays of a lobe."""
        job, usual = Job(request), mirrored.RAYS
        vars(job).update({name: value for name, value in vars(self.job).items() if name in SHARED})
        mirrored.RAYS = rays
        try:
            seconds, splats = seconds_of(lambda: Results(job).relit.relit(shaded))
        finally:
            mirrored.RAYS = usual
        shown = splats.take(job.known.binding.drawn_rows)
        colors = [shown.colors_toward(view.eye).astype(np.float32) for view in self.views]
        pairs = zip(self.views, colors, strict=True)
        return seconds, np.concatenate([view.blending.drawn(each)[view.known] for view, each in pairs])

    @cached_property
    def views(self):
        """SurfacePixels of views from around an object, none of which the fit of the harmonics has."""
        binding, motion = self.job.known.binding, np.asarray(self.scene.scene_from_splat, np.float64)
        points = binding.surface.points[binding.surface.used].astype(np.float64)
        low, high = points.min(axis=0), points.max(axis=0)
        up, center = motion[1, :3] / np.linalg.norm(motion[1, :3]), (low + high) / 2
        ways = even_directions(3 * PICTURES)
        ways = ways[ways @ up > 0.2][:PICTURES]
        distance = 1.2 * float(np.linalg.norm(high - low))
        looks = binding.looks_at([View.look_at(center + distance * way, center, up, 50.0, SIDE) for way in ways])
        return [SurfacePixels.of_view(looks, binding.surface, number) for number in range(len(looks.eyes))]
