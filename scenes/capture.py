"""A place as its capture would be trained: splats as fine as the cameras were near, leaves, far sky, floaters."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.special import expit

from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import srgb_from_linear
from splat2mesh.splats.splats import SH_C0, Splats

from .cameras import FLIP
from .light import exposure
from .sky import sky_points
from .splat import COLOR_NOISE, aligned, surface_samples

SH_C1 = np.sqrt(3 / (4 * np.pi))

LEAF_SHARE, SKY_SHARE, FLOATER_SHARE = 0.45, 0.12, 0.002
"""Of all splats: at most for leaves, for the sky where it is seen, and for floaters before the cameras. A trained
garden of 71,561 splats has 0.17 beyond its trees."""

NEAREST_M = 0.9
"""Nearer than this no camera came for long: the spacing of splats stops to shrink with the distance."""

DARK = 1e-4
"""Share of the mean sky's radiance below which a place is dark, and exposure impossible."""

COARSER_VOLUME = 1.7
"""Factor on the spacing on soil and inside crowns, which leaves cover."""

LOOKS = 28
"""Views that show how near a face was seen."""

CANDIDATES, DETAIL_RANGE = 3, (0.5, 2.0)
"""Points tried for each splat, and how far detail moves their density from the mean's: training splits splats where
the picture has detail."""

FINEST = 0.5
"""Spacing at bends over that on flat ground: all is slats and mouldings here, so less than on objects."""

LONG_AXIS, OPACITY_LOGIT = 1.15, 0.9
"""As in `scenes.splat`, for places: longest scale in spacings and the mean logit of the opacity (median 0.7; a
trained garden has 0.56 near its cameras, a quarter of it above 0.9)."""

EDGE_REACH, STEEP, EDGE_WIDTH = 0.6, 0.4, 0.8
"""Splats follow edges in the colours, as trained ones do: where the log of the albedo changes by more than
STEEP over twice EDGE_REACH spacings, and they are as much narrower there."""

SHARPER, NEIGHBORS = 0.7, 12
"""Training makes each splat's colour differ more from its neighbours' than the surface does, because they blend: by
this share of the difference from the mean of as many neighbours."""

LEAF_LONG, LEAF_WIDE, LEAF_THIN, LEAF_SPREAD = 0.32, 0.42, 0.16, 0.25
"""Standard deviations of a leaf's splat: of its length, its width, and the thin one of its width; spread of the log."""

LEAF_TILT_RAD, LEAF_LOGIT, LEAF_LOGIT_SPREAD = 0.25, 1.6, 1.6
"""Noise of a leaf's direction, and its opacity's: trained foliage is noisy; median opacity 0.83."""

FLOATER_AHEAD_M, FLOATER_SIZE_M, FLOATER_OPACITY = (0.3, 1.1), 0.025, (0.03, 0.25)
VIEW_NOISE = 0.02
"""Standard deviation of the degree-1 coefficients that training leaves on matt surfaces."""


@dataclass(frozen=True)
class Capture:
    """Splats of a place whose colours can be relit: all but the colours stays unchanged.

    splats: Splats in the splat's frame, under the light of the capture. exposure: factor from radiance to colours.
    region: (N,) uint8: SOLID, LEAF, SKY or FLOATER. faces, weights: row of place.faces (N,) and barycentric (N, 3)
    of solid splats and leaves; -1 elsewhere. toward: (N, 3) direction of the sky's splats. front: (N,) share of a
    leaf's front in its colour.
    """

    splats: Splats
    exposure: float
    region: np.ndarray
    faces: np.ndarray
    weights: np.ndarray
    toward: np.ndarray
    front: np.ndarray
    noise: np.ndarray
    tint: np.ndarray

    def lit(self, lighting):
        """The same splats under another Lighting of the same place, at the same exposure: the true answer."""
        return replace(self.splats, sh=_colors(self, lighting, self.splats.degree))

    def albedo(self, place):
        """Linear albedo (N, 3) of each splat, the target of a relighting; NaN for splats without one."""
        found = np.full((len(self.region), 3), np.nan, np.float32)
        rows = np.flatnonzero(self.faces >= 0)
        corners = place.faces[self.faces[rows]]

        def at(values):
            return np.einsum("nc,nck->nk", self.weights[rows], values[corners])

        parts = place.part[corners[:, 0]]
        found[rows] = place.albedo(at(place.vertices), at(place.normals), parts, at(place.albedo_linear))
        return found


SOLID, LEAF, SKY, FLOATER = range(4)


def capture(place, lighting, views, count, seed=0, degree=0):
    """`count` Gaussians as if trained on photographs of `place` from `views` under `lighting`: a Capture.

    views: of View in the splat's frame. degree: 0, or 1 with the two sides of leaves and a little noise. The same
    arguments give the same splats. Raises InputError where the views see nothing, or nothing that is lit.
    """
    rng = np.random.default_rng(seed)
    distance = seen_distance(place, lighting.caster, views)
    seen = np.isfinite(distance)
    solid_faces = place.faces[:, 0] < place.leaf_start
    if not (seen & solid_faces).any():
        raise InputError(f"{place.kind}: no view sees a surface of it")
    toward, far, angle = sky_points(place, lighting.caster, views, round(SKY_SHARE * count))
    floaters = round(FLOATER_SHARE * count)
    leaves = np.flatnonzero(seen[~solid_faces].reshape(-1, 4).any(axis=1)) if (~solid_faces).any() else np.zeros(0, int)
    kept = min(len(leaves), round(LEAF_SHARE * count))
    larger = np.sqrt(len(leaves) / max(kept, 1))
    leaves = np.sort(rng.choice(leaves, kept, replace=False))
    groups = [
        _solid(place, lighting, distance, seen & solid_faces, count - len(toward) - floaters - kept, rng),
        _leaves(place, views, leaves, larger, rng),
        _far(views, toward, far, angle, rng),
        _loose(views, floaters, rng),
    ]
    rows = [np.concatenate(column) for column in zip(*groups, strict=True)]
    means, scales, quats, opacities, faces, weights, ways, front, tint = rows
    region = np.repeat(np.arange(4, dtype=np.uint8), [len(group[0]) for group in groups])
    noise = np.float32(COLOR_NOISE) * rng.standard_normal((len(means), 3), np.float32)
    bare = Splats(means * FLIP, scales, quats * [1.0, *FLIP], opacities, np.zeros((len(means), (degree + 1) ** 2, 3)))
    made = Capture(bare, 1.0, region, faces.astype(np.int64), weights, ways, front, noise, tint)
    radiance = lighting.at(made.faces[region == SOLID], weights[region == SOLID])
    glows = place.emitted[place.faces[made.faces[region == SOLID], 0]].any(axis=1)
    if not radiance[~glows].max(initial=0.0) > DARK:
        raise InputError(f"{place.kind} under {lighting.environment.name}: no light reaches what the views see")
    made = replace(made, exposure=float(exposure(radiance[~glows])))
    return replace(made, splats=replace(bare, sh=_colors(made, lighting, degree)))


def seen_distance(place, caster, views):
    """Distance of the nearest view of each face's front, (F,) metres; infinite if no view sees its middle."""
    corners = place.vertices[place.faces]
    middle = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)
    origin, found = middle + np.float32(1e-3) * normal, np.full(len(middle), np.inf)
    for view in views[:: max(1, len(views) // LOOKS)]:
        pixels, depth = view.project(middle * FLIP)
        to_eye = (view.center * FLIP - middle).astype(np.float32)
        away = np.linalg.norm(to_eye, axis=1)
        inside = (pixels > 0).all(axis=1) & (pixels < [view.width, view.height]).all(axis=1) & (depth > 0)
        rows = np.flatnonzero(inside & ((to_eye * normal).sum(axis=1) > 0.02 * away) & (away < found))
        free = ~caster.occluded(np.hstack([origin[rows], to_eye[rows]]), far=1.0)
        found[rows[free]] = away[rows[free]]
    return found


def _solid(place, lighting, distance, seen, count, rng):
    solids = replace(
        place,
        vertices=place.vertices[: place.leaf_start],
        normals=place.normals[: place.leaf_start],
        faces=place.faces[place.faces[:, 0] < place.leaf_start],
    )
    seen, spread = seen[: len(solids.faces)], np.maximum(distance[: len(solids.faces)], NEAREST_M)
    spread = spread * np.where(place.volume[solids.faces[:, 0]], COARSER_VOLUME, 1.0)
    found = surface_samples(solids, CANDIDATES * count, rng, seen, spread, FINEST)
    points, normals, rows, _, weights, bend, thickness, spacing = found
    radiance = lighting.at(rows, weights)
    kept, larger = _where_detail_is(radiance, count, rng)
    points, normals, rows, weights, bend, thickness, spacing = (
        a[kept] for a in (points, normals, rows, weights, bend, thickness, spacing)
    )
    spacing = spacing * larger
    along = _edges(place, rows, weights, points, normals, spacing)
    splats = aligned(points, normals, normals, bend, thickness, spacing, rng, LONG_AXIS, OPACITY_LOGIT, along)
    splats[1][along.any(axis=1), 1] *= EDGE_WIDTH
    return _group(*splats[:4], rows, weights)


def _where_detail_is(radiance, count, rng):
    """Choose `count` of the candidates, in the order of a space-filling curve, by the detail of their colours.

    Returns rows (count,) in order, and how much larger the spacing becomes there than the candidates'.
    """
    tone = np.log(np.maximum(radiance.mean(axis=1), 1e-6) + 0.02 * radiance.mean())
    reach = 2 * CANDIDATES
    smooth = uniform_filter1d(tone.astype(np.float64), reach)
    detail = np.sqrt(np.maximum(uniform_filter1d((tone - smooth) ** 2, reach), 0))
    density = np.clip(detail / max(np.median(detail), 1e-6), *DETAIL_RANGE)
    reached = np.cumsum(density)
    kept = np.searchsorted(reached, (np.arange(count) + rng.uniform()) * reached[-1] / count)
    kept = np.minimum(kept, len(radiance) - 1)
    return kept, np.sqrt(reached[-1] / (count * density[kept])).astype(np.float32)


def _edges(place, rows, weights, points, normals, spacing):
    """Tangents along which the albedo hardly changes, (N, 3), where it changes much across them; else 0."""
    corners = place.faces[rows]
    flat = np.einsum("nc,nck->nk", weights, place.albedo_linear[corners])
    helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    side = np.cross(normals, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(normals, side)
    step = EDGE_REACH * spacing[:, None]

    def tone(shift):
        albedo = place.albedo((points + step * shift).astype(np.float32), normals, place.part[corners[:, 0]], flat)
        return np.log(np.maximum(albedo.mean(axis=1), 1e-3))

    slopes = np.stack([tone(way) - tone(-way) for way in (side, other)], axis=1)
    steep = np.linalg.norm(slopes, axis=1)
    along = (slopes[:, :1] * other - slopes[:, 1:] * side) / np.maximum(steep, 1e-9)[:, None]
    return np.where((steep > STEEP)[:, None], along, 0.0)


def _leaves(place, views, chosen, larger, rng):
    corners = place.leaves[chosen].astype(np.float64)
    long = (corners[:, 2:].sum(axis=1) - corners[:, :2].sum(axis=1)) / 2
    wide = np.maximum(
        np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1), np.linalg.norm(corners[:, 2] - corners[:, 3], axis=1)
    )
    length = np.linalg.norm(long, axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], long)
    frame = np.stack([long, np.cross(normal, long), normal], axis=2)
    frame /= np.maximum(np.linalg.norm(frame, axis=1, keepdims=True), 1e-12)
    tilt = Rotation.from_rotvec(LEAF_TILT_RAD * rng.normal(size=(len(chosen), 3)))
    quats = (Rotation.from_matrix(frame) * tilt).as_quat(scalar_first=True) if len(chosen) else np.zeros((0, 4))
    scales = np.stack([LEAF_LONG * length, LEAF_WIDE * wide, LEAF_THIN * wide], axis=1)
    scales *= larger * np.exp(LEAF_SPREAD * rng.normal(size=scales.shape))
    means = corners.mean(axis=1) + 0.1 * length[:, None] * rng.normal(size=(len(chosen), 3))
    opacities = expit(LEAF_LOGIT + LEAF_LOGIT_SPREAD * rng.normal(size=len(chosen)))
    first = np.searchsorted(place.faces[:, 0], place.leaf_start)
    away = np.stack([view.center * FLIP for view in views])[None] - corners.mean(axis=1)[:, None]
    cosine = np.einsum("nvk,nk->nv", away, frame[:, :, 2]) / np.linalg.norm(away, axis=2) ** 2
    front = np.maximum(cosine, 0).sum(axis=1) / np.maximum(np.abs(cosine).sum(axis=1), 1e-12)
    halves = np.tile([0.5, 0.0, 0.5], (len(chosen), 1))  # of the faces 0 and 3 of a leaf: its middle
    return _group(means, scales, quats, opacities, first + 4 * chosen, halves, front=front)


def _far(views, toward, far, angle, rng):
    middle = np.mean([view.center * FLIP for view in views], axis=0)
    spacing = (far * angle).astype(np.float32)
    endless = np.full(len(far), np.inf, np.float32)
    points, normals = (middle + far[:, None] * toward).astype(np.float32), -toward.astype(np.float32)
    means, scales, quats, opacities, _ = aligned(points, normals, normals, endless, endless, spacing, rng)
    return _group(means, scales, quats, opacities, ways=toward)


def _loose(views, count, rng):
    """Faint blobs right before the cameras, where training leaves them."""
    chosen = rng.integers(len(views), size=count)
    eyes, forward = (np.stack([getattr(view, name) * FLIP for view in views]) for name in ("center", "forward"))
    ahead = rng.uniform(*FLOATER_AHEAD_M, (count, 1))
    means = eyes[chosen] + ahead * (forward[chosen] + 0.3 * rng.normal(size=(count, 3)))
    scales = FLOATER_SIZE_M * np.exp(0.6 * rng.normal(size=(count, 3)))
    quats, tint = rng.normal(size=(count, 4)), np.repeat(rng.uniform(0.2, 0.8, (count, 1)), 3, axis=1)
    return _group(means, scales, quats, rng.uniform(*FLOATER_OPACITY, count), tint=tint)


def _group(means, scales, quats, opacities, faces=None, weights=None, ways=None, front=None, tint=None):
    count = len(means)
    faces = np.full(count, -1) if faces is None else faces
    weights, ways, tint = (np.zeros((count, 3), np.float32) if a is None else a for a in (weights, ways, tint))
    front = np.ones(count) if front is None else front
    return means, scales, quats, opacities, faces, weights, ways, front, tint


def _colors(made, lighting, degree):
    """Harmonics (N, K, 3) of the splats under a light: display-referred, clipped like a photograph."""
    colors = made.tint.astype(np.float32).copy()

    def shown(radiance):
        return np.clip(srgb_from_linear(made.exposure * np.asarray(radiance, np.float64)), 0, 1).astype(np.float32)

    solid, leaf, sky = (np.flatnonzero(made.region == kind) for kind in (SOLID, LEAF, SKY))
    colors[solid] = shown(lighting.at(made.faces[solid], made.weights[solid]))
    near = cKDTree(made.splats.means[solid]).query(made.splats.means[solid], NEIGHBORS)[1]
    alike = lighting.place.part[lighting.place.faces[made.faces[solid], 0]]
    same = (alike[near] == alike[:, None]).astype(np.float32)
    mean = np.einsum("nm,nmk->nk", same, colors[solid][near]) / same.sum(axis=1, keepdims=True)
    colors[solid] += np.float32(SHARPER) * (colors[solid] - mean)
    sides = [shown(lighting.at(made.faces[leaf] + side, made.weights[leaf])) for side in (0, 3)]
    front = made.front[leaf, None].astype(np.float32)
    colors[leaf] = front * sides[0] + (1 - front) * sides[1]
    colors[sky] = shown(lighting.environment.lookup(made.toward[sky])) if len(sky) else 0.0
    harmonics = ((np.clip(colors + made.noise, 0, 1) - 0.5) / SH_C0)[:, None]
    if degree == 0:
        return harmonics
    rng = np.random.default_rng(len(colors))
    tilted = np.float32(VIEW_NOISE) * rng.standard_normal((len(colors), 3, 3), np.float32)
    corners = lighting.place.faces[made.faces[leaf], 0]
    y, z, x = (lighting.place.normals[corners] * FLIP)[:, [1, 2, 0]].T
    # Seen along d a leaf shows its front by (1 - n.d) / 2; the basis has -y, z, -x (`sh_basis_3dgs`).
    difference = (sides[0] - sides[1]) / np.float32(2 * SH_C1)
    tilted[leaf] += np.stack([y, -z, x], axis=1)[..., None] * difference[:, None]
    return np.concatenate([harmonics, tilted.astype(np.float32)], axis=1)
