"""Views of glossy objects: GGX reflections of the light and of the scene, and harmonics trained on them.

The lobe is sampled by the normals that an eye sees, its light found by rays: no step is shared with `relight.gloss`,
which is compared to it. Sources: Heitz, "Sampling the GGX distribution of visible normals" (JCGT 2018); Dupuy and
Benyoub, "Sampling visible GGX normals with spherical caps" (HPG 2023); Schlick, "An inexpensive BRDF model for
physically-based rendering" (1994).
"""

from dataclasses import replace

import numpy as np

from relight import Environment
from relight.light.projections import row_solid_angles, texel_directions
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import srgb_from_linear
from splat2mesh.splats.splats import Splats, sh_basis_3dgs

from .cameras import FLIP
from .light import CLEARANCE, bake, exposure
from .splat import COLOR_NOISE, PLASTIC, _from_z_to, surface_samples

SAMPLES = 12
"""Rays of a lobe towards one eye; harmonics are fitted to dozens of eyes, each with other rays."""

COARSE = 32, 64
"""Texels of the light that lobes see: 5.6 degrees, so that a dozen rays do not miss a sun. Half as wide as the
sharpest lobe, a quarter of what harmonics of degree 3 show."""

FINER = 8
"""Lookups along each side of such a texel."""

DEGREE = 3

RIDGE = 0.3
"""Eyes that hold each coefficient but the constant one to 0."""

VIEW_NOISE = 0.02
"""Standard deviation of each of those coefficients, as training leaves it."""

WIDTH, THICKNESS, SPREAD, OPACITY = 0.7, 0.05, 0.2, 0.9
"""Discs on the surface: standard deviations in spacings along it and across, spread of their log, opacity. Splats that
lie as untidily as those of `scenes.splat` show other neighbours from every side, which buries what glazes reflect:
training makes up for that, and nobody trains here."""

LEAST_COSINE = 0.05
"""Under flatter angles no eye is asked."""

BLOCK = 1024


def glossy_splats(truth, environments, views, count, seed=0, seen=None):
    """`count` Gaussians of degree 3 as if trained on photographs of a GlossyTruth, under each of some lights.

    environments: of relight.Environment, each exposed as a photographer would. views: of View in the splat's frame.
    seen: (F,) bool, the faces that are covered; all unless given. Returns a list of Splats in the splat's frame, which
    differ in their harmonics alone, and the exposures (L,). The same arguments give the same splats.
    """
    rng = np.random.default_rng(seed)
    points, normals, rows, _, weights, _, _, spacing = surface_samples(truth, count, rng, seen)
    scales = spacing[:, None] * [WIDTH, WIDTH, THICKNESS] * np.exp(SPREAD * rng.standard_normal((count, 3)))
    means, quats = points - THICKNESS * spacing[:, None] * normals, _from_z_to(normals)
    diffuse = [bake(truth, environment) for environment in environments]
    matte = np.unique(truth.faces[rows if seen is None else np.flatnonzero(seen)])
    matte = matte[~truth.metal[matte]]
    factors = np.array([exposure(each[matte]) for each in diffuse])
    eyes = np.stack([view.center for view in views]) * FLIP
    found = np.zeros((len(environments), count, (DEGREE + 1) ** 2, 3), np.float32)
    caster = RayCaster(truth.vertices, truth.faces)
    lights = [_coarse(environment) for environment in environments]
    for start in range(0, count, BLOCK):
        block = slice(start, start + BLOCK)
        place = points[block], normals[block], truth.faces[rows[block]], weights[block]
        found[:, block] = _harmonics(truth, caster, place, eyes, diffuse, lights, factors)
    noise = rng.standard_normal(found.shape[1:], np.float32) * np.float32(VIEW_NOISE)
    noise[:, 0] *= COLOR_NOISE / VIEW_NOISE / 0.2820948
    bare = Splats(means * FLIP, scales, quats * [1.0, *FLIP], np.full(count, OPACITY), found[0] + noise)
    return [replace(bare, sh=sh + noise) for sh in found], factors


def mirrored_radiance(truth, caster, points, normals, faces, weights, toward, diffuse, lights):
    """(L, N, 3) radiance that points of a GlossyTruth send to eyes by reflection, under each of L lights.

    points, normals, toward: (N, 3), the last to the eye. faces, weights: (N, 3) vertices and barycentric. diffuse: of
    each light, (V, 3) radiance that vertices send out. Things in the mirror look as if they were matte.
    """
    strength = np.einsum("nc,nck->nk", weights, truth.reflectance[faces])
    alpha = truth.alpha[faces[:, 0]]
    total = np.zeros((len(lights), len(points), 3))
    seeds = np.arange(len(points)) * 0.6180339887498949
    lift = np.float32(CLEARANCE * np.linalg.norm(np.ptp(truth.vertices, axis=0)))
    origins = (points + lift * normals).astype(np.float32)
    # The metals of the scene appear in a mirror as bright as a matte object of their colour.
    painted = [each + truth.reflectance * _white(each, truth) * truth.metal[:, None] for each in diffuse]
    for sample in range(SAMPLES):
        one, two = ((seeds * (1 + power) + sample / PLASTIC**power) % 1.0 for power in (1, 2))
        way, weight = lobe_sample(alpha, normals, toward, one, two, strength)
        hits = caster.first_hits(np.hstack([origins, way.astype(np.float32)]))
        free = ~np.isfinite(hits.distance)
        corner = truth.faces[np.where(free, 0, hits.faces)]
        u, v = np.where(free, 0.0, hits.uv.T)
        shares = np.stack([1.0 - u - v, u, v], axis=1)
        for number, light in enumerate(lights):
            hidden = np.einsum("nc,nck->nk", shares, painted[number][corner])
            total[number] += weight * np.where(free[:, None], light.lookup(way), hidden)
    return total / SAMPLES


def lobe_sample(alpha, normals, toward, one, two, reflectance):
    """Directions (N, 3) from which a GGX lobe takes light, and their weight (N, 3), 0 below the surface.

    one, two: (N,) in [0, 1). The mean of weight times radiance over both is the reflected radiance. Reflectance (N, 3)
    at normal incidence rises towards 1 by Schlick's formula; shadowing and masking are Smith's, with height.
    """
    helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    side = np.cross(helper, normals)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    frame = np.stack([side, np.cross(normals, side), normals], axis=1)
    eye = np.einsum("nij,nj->ni", frame, toward)
    stretch = np.stack([alpha, alpha, np.ones_like(alpha)], axis=1)
    wide = eye * stretch
    wide /= np.linalg.norm(wide, axis=1, keepdims=True)
    up = (1.0 - two) * (1.0 + wide[:, 2]) - wide[:, 2]
    across, turn = np.sqrt(np.clip(1.0 - up**2, 0.0, 1.0)), 2 * np.pi * one
    half = (np.stack([across * np.cos(turn), across * np.sin(turn), up], axis=1) + wide) * stretch
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-12)
    cosine = np.einsum("ni,ni->n", eye, half)
    light = 2.0 * cosine[:, None] * half - eye
    above = light[:, 2] > 1e-4
    masked, shadowed = (_smith(np.maximum(each[:, 2], 1e-4), alpha) for each in (eye, light))
    fresnel = reflectance + (1.0 - reflectance) * ((1.0 - np.clip(cosine, 0, 1)) ** 5)[:, None]
    weight = fresnel * np.where(above, (1.0 + masked) / (1.0 + masked + shadowed), 0.0)[:, None]
    return np.einsum("nij,ni->nj", frame, light), weight


def _smith(cosine, alpha):
    """Smith's Lambda."""
    return (np.sqrt(1.0 + alpha**2 * (1.0 / cosine**2 - 1.0)) - 1.0) / 2.0


def _harmonics(truth, caster, place, eyes, diffuse, lights, factors):
    """(L, N, K, 3) harmonics, fitted to what each eye sees of points of the surface, display-referred and clipped."""
    points, normals, faces, weights = place
    away = eyes[None] - points[:, None]
    away /= np.linalg.norm(away, axis=2, keepdims=True)
    cosine = np.einsum("nek,nk->ne", away, normals)
    point, eye = np.nonzero(cosine > LEAST_COSINE)
    glossy = truth.reflectance[faces[:, 0]].any(axis=1)
    matte = np.stack([np.einsum("nc,nck->nk", weights, each[faces]) for each in diffuse])
    shown = matte[:, point].astype(np.float64)
    rows = np.flatnonzero(glossy[point])
    of, toward = point[rows], away[point[rows], eye[rows]]
    shown[:, rows] += mirrored_radiance(
        truth, caster, points[of], normals[of], faces[of], weights[of], toward, diffuse, lights
    )
    shown = np.clip(srgb_from_linear(factors[:, None, None] * shown), 0.0, 1.0) - 0.5
    basis = sh_basis_3dgs(-away[point, eye] * FLIP, DEGREE)
    full = np.zeros((*away.shape[:2], basis.shape[1]))
    full[point, eye] = basis * np.sqrt(cosine[point, eye])[:, None]
    color = np.zeros((len(lights), *away.shape))
    color[:, point, eye] = shown * np.sqrt(cosine[point, eye])[:, None]
    hold = np.full(basis.shape[1], RIDGE)
    hold[0] = 1e-6
    square = np.einsum("nek,nel->nkl", full, full, optimize=True) + np.diag(hold)
    return np.stack([np.linalg.solve(square, np.einsum("nek,nec->nkc", full, each, optimize=True)) for each in color])


def _white(diffuse, truth):
    """(V, 3) about what something white sends out at metal vertices: the mean of the others', by their albedo."""
    others = ~truth.metal
    mean = diffuse[others].mean(axis=0) / np.maximum(truth.albedo_linear[others].mean(axis=0), 1e-6)
    return np.broadcast_to(mean.astype(np.float32), diffuse.shape)


def _coarse(environment):
    """The Environment averaged over texels of COARSE, canonical and not turned."""
    height, width = COARSE
    fine = texel_directions(FINER * height, FINER * width)
    areas = np.broadcast_to(row_solid_angles(FINER * height, FINER * width).reshape(-1, 1, 1), (*fine.shape[:2], 1))
    values = environment.lookup(fine.reshape(-1, 3)).reshape(fine.shape) * areas

    def pooled(image):
        return image.reshape(height, FINER, width, FINER, -1).sum(axis=(1, 3))

    return Environment(pooled(values) / pooled(areas), environment.name)
