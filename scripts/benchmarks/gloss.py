"""Which patches of glossy and matte scenes are found glossy, and the gain of splats with moving highlights.

Tables are generated (`scenes.ceramics`), CASE being SEED:LIGHT, or mSEED:LIGHT for the same without its gloss. Each is
meshed, its light estimated, and relit with gloss and without. "explained" is the share of the view-dependent part that
the reflected light explains, of `relight.gloss.material`. "light" is the angle between the direction of the captured
light as estimated and its true one. PSNR is against the same Gaussians trained under the new light, in sRGB, with one
gain for each colour: over the table, and over what is glossy. With --trained, all-matte scenes of groundtruth/NAME
are measured, too.
"""

import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.harness import GROUND_TRUTH
from relight.gloss.fits import PatchFits
from relight.gloss.material import LEAST_EXPLAINED, SURE_EXPLAINED, Lobe, best_lobe
from relight.jobs.job import Job
from relight.jobs.results import Results
from relight.request import RelightRequest
from relight.sh import harmonics
from scenes import capture_views, seen_faces
from scenes.cameras import FLIP
from scenes.ceramics import ceramics
from scenes.highlights import glossy_splats
from scenes.sky import capture_sky
from splat2mesh import convert
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import linear_from_srgb, luminance, srgb_from_linear

QUICK = ["2:studio", "--splats", "2500", "--vertices", "3000", "--relit", "sunset", "--views", "2"]

CASES = [
    f"{seed}:{light}" for seed, light in zip(range(100, 108), 2 * ("studio", "noon", "cloudy", "sunset"), strict=True)
]
MATTE = [
    f"m{seed}:{light}" for seed, light in zip(range(108, 112), ("studio", "noon", "cloudy", "sunset"), strict=True)
]
"""Seeds that nothing else uses."""

THRESHOLDS = (0.0125, 0.025, 0.05, 0.1)
EFFECTS = "shadows,sun,bounces,volume"


def arguments(parser):
    """Arguments of this subject."""
    parser.add_argument("cases", nargs="*", default=[*CASES, *MATTE], metavar="CASE")
    parser.add_argument("--trained", nargs="*", default=[], metavar="NAME", help="matte scenes of --data to look at")
    parser.add_argument("--data", type=Path, default=GROUND_TRUTH)
    parser.add_argument("--splats", type=int, default=12_000)
    parser.add_argument("--vertices", type=int, default=12_000)
    parser.add_argument("--relit", nargs="*", default=["noon", "sunset"], metavar="LIGHT")
    parser.add_argument("--views", type=int, default=6, help="pictures that are compared")


def run(options, report):
    """Each case: the tables of its patches and of its relit splats."""
    shares = {f"from_{each:g}": ".2f" for each in THRESHOLDS}
    columns = {
        "case": "<12",
        "planned": "<8",
        "patches": "d",
        "matte_most": ".3f",
        "matte_sure": "d",
        "glossy_sure": "d",
    }
    patches = report.table("patches", **columns, **shares, light=".0f")
    columns = {"thing": "<7", "alpha": ".2f", "alpha_found": ".2f", "f0": ".2f", "f0_found": ".2f"}
    things = report.table("things", case="<12", **columns)
    columns = {
        "case": "<12",
        "light": "<8",
        "without": ".2f",
        "with": ".2f",
        "glossy_without": ".2f",
        "glossy_with": ".2f",
    }
    relit = report.table("psnr", **columns)
    with tempfile.TemporaryDirectory() as folder:
        for case in options.cases:
            table = Table(case, options, Path(folder) / case.replace(":", "-"))
            looked = look(table.job(table.lights[0], f"{EFFECTS},gloss"))
            patches.add(**patch_row(case, looked, table.glossy_patches(looked), table.light_error(looked)))
            for row in table.things(looked):
                things.add(case=case, **row)
            for number, name in enumerate(table.names):
                relit.add(case=case, light=name, **table.gains(number + 1, options.views))
        for name in options.trained:
            source = options.data / "groundtruth" / name / "point_cloud.ply"
            scene = Path(folder) / name
            convert(source, up="+y").save(scene)
            looked = look(Job(RelightRequest.of(scene, "captured", effects=f"{EFFECTS},gloss")))
            patches.add(**patch_row(name, looked, np.zeros(len(looked[2].alpha), bool), None))


def look(job):
    """(SceneGloss, Appearance, Lobes of the patches (P), whose fields are stacked) of a Job."""
    gloss, appearance = job.known.gloss, job.known.appearance
    fits = None if gloss is None else gloss.fits
    if fits is None or appearance.environment is None:
        none = np.zeros(0)
        return gloss, appearance, Lobe(none, np.zeros((0, 3)), none, none)
    light = appearance.environment.sh(harmonics.MAX_BANDS)[: fits.gram.shape[-1] + 1]
    found = [
        best_lobe(fits, patch, light) if fits.pixels[patch] else Lobe(0.0, np.zeros(3), 1.0, False)
        for patch in range(len(fits.pixels))
    ]
    return gloss, appearance, Lobe(*(np.array(each) for each in zip(*found, strict=True)))


def patch_row(case, looked, glossy, light):
    """A row of the table of patches. glossy: (P,) bool, the truth."""
    gloss, appearance, (explained, *_) = looked
    if not len(explained):
        return {"case": case, "planned": "unseen", "patches": 0}
    fits: PatchFits = gloss.fits
    seen, informative = fits.pixels > 0, fits.informative
    matte = explained[seen & ~glossy]
    row = {"case": case, "planned": "no" if gloss.of(appearance) is None else "yes", "patches": int(seen.sum())}
    row |= {"matte_most": float(matte.max(initial=0.0)), "light": light}
    row["matte_sure"], row["glossy_sure"] = (
        int(np.count_nonzero((explained > SURE_EXPLAINED) & informative & kind)) for kind in (~glossy, glossy)
    )
    if (seen & glossy).any():
        row |= {f"from_{each:g}": float((explained[seen & glossy] > each).mean()) for each in THRESHOLDS}
    return row


class Table:
    """A generated table, its splats under every light, and the scene that is meshed of the first."""

    def __init__(self, case, options, folder):
        seed, light = case.split(":")
        self.names = [name for name in options.relit if name != light]
        self.lights = [capture_sky(name) for name in (light, *self.names)]
        number = int(seed.removeprefix("m"))
        self.truth = ceramics(number, options.vertices, glossy=not seed.startswith("m"))
        self.views = capture_views(self.truth, 64)
        seen = seen_faces(self.truth, self.views)
        self.splats, _ = glossy_splats(self.truth, self.lights, self.views, options.splats, number, seen)
        folder.mkdir()
        self.splats[0].save(folder / "splat.ply")
        self.scene = folder / "scene"
        convert(folder / "splat.ply", up="-y").save(self.scene)
        self._near = cKDTree(self.truth.vertices)

    def job(self, environment, effects, *formats):
        """A Job that relights the scene; a splat unless other formats are asked for."""
        return Job(RelightRequest.of(self.scene, environment, effects=effects, formats=formats or ("splat",)))

    def of_nodes(self, looked):
        """(M,) the vertex of the truth that is nearest to each node."""
        surface = looked[0]._binding().surface
        return self._near.query(surface.points * FLIP)[1]

    def glossy_patches(self, looked):
        """(P,) bool: those most of whose nodes are glossy."""
        count = len(looked[2].alpha)
        if not count:
            return np.zeros(0, bool)
        patch, glossy = looked[0].fits.patch, self.truth.glossy[self.of_nodes(looked)]
        return np.bincount(patch, glossy, count) > 0.5 * np.bincount(patch, minlength=count)

    def things(self, looked):
        """Rows of the glossy objects: medians of what their patches were found to be, weighted by nodes."""
        if not len(looked[2].alpha):
            return
        nodes, patch = self.of_nodes(looked), looked[0].fits.patch
        explained, reflectance, alpha, _ = looked[2]
        found = luminance(reflectance)
        for part in range(int(self.truth.part.max()) + 1):
            rows = np.flatnonzero(self.truth.part == part)
            mine = patch[self.truth.part[nodes] == part]
            mine = mine[explained[mine] > LEAST_EXPLAINED]
            if not self.truth.glossy[rows[0]] or not len(mine):
                continue
            f0 = float(luminance(self.truth.reflectance[rows[0]]))
            row = {
                "thing": "metal" if self.truth.metal[rows[0]] else "glaze",
                "alpha": float(self.truth.alpha[rows[0]]),
            }
            row |= {"alpha_found": float(np.median(alpha[mine])), "f0": f0}
            yield row | {"f0_found": float(np.median(found[mine]))}

    def light_error(self, looked):
        """Degrees between the linear part of the estimated light and of the true one."""
        if looked[1].environment is None:
            return None
        ways = [luminance(light.sh(2)[1:4]) for light in (looked[1].environment, self.lights[0])]
        cosine = ways[0] @ ways[1] / max(np.linalg.norm(ways[0]) * np.linalg.norm(ways[1]), 1e-12)
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))

    def gains(self, number, views):
        """PSNR without gloss and with it, under one of the new lights."""
        step = max(1, len(self.views) // views)
        chosen = [view.resized(192) for view in self.views[step // 2 :: step][:views]]
        wanted = [rasterize(self.splats[number], view) for view in chosen]
        inside = [picture.alpha > 0.5 for picture in wanted]
        glossy = np.concatenate([self._glossy(view)[rows] for view, rows in zip(chosen, inside, strict=True)])
        truth = np.concatenate([np.clip(p.color[rows], 0, 1) for p, rows in zip(wanted, inside, strict=True)])
        row = {}
        for name, effects in (("without", EFFECTS), ("with", f"{EFFECTS},gloss")):
            job = self.job(self.lights[number], effects)
            splats = Results(job).relit.relit(next(job.shaded()))
            shown = np.concatenate(
                [np.clip(rasterize(splats, view).color[rows], 0, 1) for view, rows in zip(chosen, inside, strict=True)]
            )
            error = (_balanced(shown, truth) - truth) ** 2
            row[name] = float(-10 * np.log10(error.mean()))
            if glossy.any():
                row[f"glossy_{name}"] = float(-10 * np.log10(error[glossy].mean()))
        return row

    def _glossy(self, view):
        """(H, W) bool: pixels of a view that show glossy surfaces."""
        rays = view.ray_directions().reshape(-1, 3) * FLIP
        start = np.broadcast_to(view.center * FLIP, rays.shape)
        hits = RayCaster(self.truth.vertices, self.truth.faces).first_hits(np.hstack([start, rays]).astype(np.float32))
        met = np.isfinite(hits.distance)
        vertex = self.truth.faces[np.where(met, hits.faces, 0), 0]
        return (met & self.truth.glossy[vertex]).reshape(view.height, view.width)


def _balanced(shown, truth):
    """Display colours (N, 3), each channel times the gain in linear light that fits the truth best."""
    linear, wanted = linear_from_srgb(shown), linear_from_srgb(truth)
    gain = (linear * wanted).sum(axis=0) / np.maximum((linear**2).sum(axis=0), 1e-12)
    return srgb_from_linear(np.clip(gain * linear, 0, 1))
