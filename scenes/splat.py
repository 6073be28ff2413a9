"""Gaussian splats that look trained: surface-aligned, uneven, mostly translucent, a little untidy.

The figures in brackets were read off two vanilla 3DGS trainings (an object of 22k splats, a tabletop of 39k)
whose mesh is known. A spacing is the side of the square that one splat has to cover; logs are natural.
"""

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import expit, ndtri

from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import srgb_from_linear
from splat2mesh.splats.splats import SH_C0, Splats

from .cameras import FLIP

LONG_AXIS, LONG_AXIS_SPREAD = 1.5, 0.42
"""Median of the longest scale in spacings [1.70, 1.58] and spread of its log [0.42, 0.55]."""

MIDDLE_LOGIT, THIN_LOGIT, RATIO_LOGIT_SPREAD = 0.1, -1.1, 1.45
"""Each further scale over the one before it is logit-normal, with medians 0.52 [0.51, 0.20] and 0.25 [0.26,
0.23]; one in twenty is beyond 0.92 [0.94, 0.85] and 0.78 [0.84, 0.88]."""

LONG_TILT_RAD = np.radians(6.5)
"""Spread of the long axis' tilt out of the surface, median 4.4 degrees [4.2, 4.8]."""

MIDDLE_TILT_RAD, ROUND_TILT_RAD = np.radians(6.0), np.radians(45.0)
"""Spread of the middle axis' tilt for a flat splat, and what a needle of round section, whose middle axis is
arbitrary, adds: median 11 degrees [10, 16]."""

DEPTH_BASE, DEPTH_IN_SIGMAS, DEPTH_SPREAD = 0.2, 2.8, 0.3
"""Trained centres lie under the surface, so that their visible edge touches it: by some spacings and by some
of their own standard deviations across the surface, in all 3.5 [3.5, 2.6] of those in the median; the spread
is of the log."""

OPACITY_LOGIT, OPACITY_LOGIT_SPREAD = -0.4, 2.5
"""Opacities are logit-normal: with the fuzz median 0.38 [0.36, 0.12], a share of 0.14 [0.21, 0.12] > 0.9."""

BEND_SPACINGS, FINEST_RATIO = 8.0, 0.4
"""Training packs splats closer where a surface bends: here to an eighth of the bend's diameter, but no closer
than 0.4 of the spacing on flat ground."""

LONGEST_IN_BENDS, LONGEST_IN_SPACINGS, DEEPEST_IN_WALLS = 0.15, 1.2, 0.4
"""The longest scale is cut to 0.15 of the bend's diameter, so that it does not stick out, but covers its own
ground with 1.2 spacings. Centres stay within 0.4 of a wall's thickness: on their own side of it."""

BEND_GRADATION, BEND_RINGS = 0.5 / LONGEST_IN_BENDS, 8
"""Beside a bend the longest scale may grow by half the distance from it, over eight rings of faces."""

COLOR_NOISE = 0.012
"""Standard deviation of an sRGB channel about the baked colour: three 8-bit steps, seen only where flat."""

FUZZ_SHARE, FUZZ_SCALE, FUZZ_HEIGHT, FUZZ_OPACITY_LOGIT = 0.03, 0.35, 1.0, -3.0
"""Share of small faint splats over the surface, size over the usual, spread of the height in spacings, mean
opacity 0.06."""

FLOATER_SHARE, FLOATER_SCALE, FLOATER_OPACITY = 5e-4, 3.0, (0.02, 0.1)
"""Share of faint blobs in empty space, their size in spacings and range of opacity: a light haze."""

GOLDEN = (1.0 + np.sqrt(5.0)) / 2.0
"""The golden ratio: the steps 1 / GOLDEN, 2 / GOLDEN, ... modulo 1 are the most even 1-D sequence."""

PLASTIC = 1.32471795724474602596
"""The plastic number, root of x^3 = x + 1: its powers do the same in 2-D (Roberts, the R2 sequence, 2018)."""


def splats_from(truth, radiance, count, seed=0, faces=None):
    """`count` Gaussians of SH degree 0 that render like the mesh: Splats in the splat's frame (y down).

    truth: SceneTruth. radiance: (V, 3) exposed linear radiance, 1 is white. faces: (F,) bool, the faces that
    were seen and so are covered; all unless given. The same arguments give the same splats.
    """
    rng = np.random.default_rng(seed)
    floaters = round(count * FLOATER_SHARE)
    points, normals, _, face, weights, bend, thickness, spacing = surface_samples(truth, count - floaters, rng, faces)
    colors = srgb_from_linear(interpolated(np.asarray(radiance, np.float32), face, weights))
    splats = aligned(points, normals, colors, bend, thickness, spacing, rng)
    if floaters:
        loose = _floaters(truth, floaters, spacing.max(), rng)
        splats = [np.concatenate(pair) for pair in zip(splats, loose, strict=True)]
    means, scales, quats_wxyz, opacities, colors = splats
    noise = np.float32(COLOR_NOISE) * rng.standard_normal(colors.shape, np.float32)
    colors = np.clip(colors + noise, 0.0, 1.0)
    sh = ((colors - 0.5) / SH_C0)[:, None]
    return Splats(means * FLIP, scales, quats_wxyz * [1.0, *FLIP], opacities, sh)


def surface_samples(truth, count, rng, faces=None, spread=1.0, finest=FINEST_RATIO):
    """`count` points on the seen surface, packed as training packs splats.

    faces: (F,) bool, those seen; all unless given. spread: (F,) relative spacing, more where less is seen.
    finest: of the spacing at bends over that on flat ground; 1 packs splats evenly.
    Returns points, normals, rows of the faces (N,), their vertices (N, 3), barycentric weights, bends, thicknesses
    and spacings.
    """
    rows = np.arange(len(truth.faces)) if faces is None else np.flatnonzero(faces)
    rows = rows[np.argsort(_morton_code(truth.vertices[truth.faces[rows]].mean(axis=1)))]
    corners = truth.vertices[truth.faces[rows]].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    bend, thickness = (sizes[truth.faces[rows]].min(axis=1) for sizes in (_bends(truth), _thicknesses(truth)))
    spread = np.broadcast_to(spread, len(truth.faces))[rows]
    coarsest = np.sqrt((area / spread**2).sum() / count)
    ratio = np.clip(bend / (BEND_SPACINGS * coarsest * spread), finest, 1.0) * spread
    reached = np.cumsum(area / ratio**2)
    # Equal steps along a curve that fills space: neighbours on the curve are neighbours on the surface.
    steps = np.arange(count)
    chosen = np.searchsorted(reached, (steps + 0.5) * (reached[-1] / count))
    face = truth.faces[rows[chosen]]
    u, v = ((steps / PLASTIC**power + rng.uniform()) % 1.0 for power in (1, 2))
    folded = u + v > 1.0
    u, v = np.where(folded, 1.0 - u, u), np.where(folded, 1.0 - v, v)
    weights = np.stack([1.0 - u - v, u, v], axis=1).astype(np.float32)
    normals = interpolated(truth.normals, face, weights)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    spacing = (np.sqrt(reached[-1] / count) * ratio[chosen]).astype(np.float32)
    points = interpolated(truth.vertices, face, weights)
    return points, normals, rows[chosen], face, weights, bend[chosen], thickness[chosen], spacing


def interpolated(values, face, weights):
    """Values of the vertices, (V, C), at points within faces: (N, C). face, weights: (N, 3) of each point."""
    return sum(weights[:, corner, None] * values[face[:, corner]] for corner in range(3))


def _thicknesses(truth):
    """The depth of the solid under each vertex: (V,) float32."""
    inward = -truth.normals
    start = truth.vertices + np.float32(1e-4 * np.ptp(truth.vertices)) * inward
    return RayCaster(truth.vertices, truth.faces).first_hits(np.hstack([start, inward])).distance


def _bends(truth):
    """Diameter of the ball that bends as the surface does at each vertex: (V,) float32, huge where flat.

    It grows no faster than BEND_GRADATION with the distance from a sharper bend, so that what lies flat
    beside an edge knows of the edge.
    """
    edges = np.concatenate([truth.faces[:, [0, 1]], truth.faces[:, [1, 2]], truth.faces[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    start, end = edges[np.argsort(edges[:, 0], kind="stable")].T
    length = np.linalg.norm(truth.vertices[start] - truth.vertices[end], axis=1)
    turning = np.linalg.norm(truth.normals[start] - truth.normals[end], axis=1)
    first_edges = np.searchsorted(start, np.arange(len(truth.vertices)))
    size = np.minimum.reduceat(2.0 * length / np.maximum(turning, 1e-6), first_edges)
    for _ in range(BEND_RINGS):
        size = np.minimum(size, np.minimum.reduceat(size[end] + BEND_GRADATION * length, first_edges))
    return size


def aligned(
    points, normals, colors, bend, thickness, spacing, rng, long_axis=LONG_AXIS, opacity_logit=OPACITY_LOGIT, along=None
):
    """Means, scales, quaternions (wxyz), opacities and colours, one Gaussian a point, in the scene frame.

    along: (N, 3) tangents that the longest axes should follow, (0, 0, 0) where they may lie as they like.
    """
    count = len(points)

    def normal_deviates(spread):
        return rng.standard_normal(count, np.float32) * np.float32(spread)

    long = spacing * long_axis * np.exp(normal_deviates(LONG_AXIS_SPREAD))
    middle = long * expit(MIDDLE_LOGIT + normal_deviates(RATIO_LOGIT_SPREAD))
    long = np.minimum(long, np.maximum(LONGEST_IN_BENDS * bend, LONGEST_IN_SPACINGS * spacing))
    middle = np.minimum(middle, long)
    roundness = expit(THIN_LOGIT + normal_deviates(RATIO_LOGIT_SPREAD))
    scales = np.stack([long, middle, middle * roundness], axis=1)
    middle_tilt = normal_deviates(1.0) * (MIDDLE_TILT_RAD + ROUND_TILT_RAD * roundness)
    long_tilt = normal_deviates(LONG_TILT_RAD)
    spin = rng.uniform(0.0, 2 * np.pi, count).astype(np.float32)
    quats = _from_z_to(normals)
    if along is not None:
        level = Rotation.from_quat(quats, scalar_first=True).apply(along, inverse=True)
        spin = np.where(level.any(axis=1), np.arctan2(level[:, 1], level[:, 0]), spin).astype(np.float32)
    for axis, angle in ((3, spin), (1, middle_tilt), (2, long_tilt)):
        quats = _then_about_axis(quats, axis, angle)
    # Third row of R_x(middle_tilt) R_y(long_tilt): how far each axis of the Gaussian points along the normal.
    along_normal = np.stack([-np.sin(long_tilt) * np.cos(middle_tilt), np.sin(middle_tilt)], axis=1)
    along_normal = np.hstack([along_normal, (np.cos(long_tilt) * np.cos(middle_tilt))[:, None]])
    sigma = np.linalg.norm(scales * along_normal, axis=1)
    depth = (DEPTH_BASE * spacing + DEPTH_IN_SIGMAS * sigma) * np.exp(normal_deviates(DEPTH_SPREAD))
    # Neighbours get unlike opacities, so that no faint patch is left uncovered: training would fill it.
    rank = (np.arange(count) / GOLDEN + rng.uniform()) % 1.0
    logits = opacity_logit + OPACITY_LOGIT_SPREAD * ndtri(np.clip(rank, 1e-7, 1.0 - 1e-7))
    depth = np.minimum(depth, DEEPEST_IN_WALLS * thickness)
    fuzz = rng.random(count, np.float32) < FUZZ_SHARE
    scales[fuzz] *= FUZZ_SCALE
    depth = np.where(fuzz, -FUZZ_HEIGHT * spacing * np.abs(normal_deviates(1.0)), depth)
    logits = np.where(fuzz, FUZZ_OPACITY_LOGIT + normal_deviates(1.0), logits)
    return points - depth[:, None] * normals, scales, quats, expit(logits), colors


def _floaters(truth, count, spacing, rng):
    """The same five arrays for faint blobs anywhere in the scene's bounding box."""
    means = rng.uniform(truth.vertices.min(axis=0), truth.vertices.max(axis=0), (count, 3))
    scales = spacing * FLOATER_SCALE * np.exp(rng.normal(0.0, 0.4, (count, 3)))
    quats = rng.normal(size=(count, 4))
    colors = np.broadcast_to(rng.uniform(0.3, 0.9, (count, 1)), (count, 3))
    return means, scales, quats, rng.uniform(*FLOATER_OPACITY, count), colors


def _morton_code(points):
    """Place of each point, (N, 3), on a Z-order curve of 1024^3 cells over their bounds: (N,) int64."""
    low = points.min(axis=0)
    cell = ((points - low) / max(np.ptp(points, axis=0).max(), 1e-30) * 1023).astype(np.int64)
    return sum(((cell[:, axis] >> bit) & 1) << (3 * bit + axis) for bit in range(10) for axis in range(3))


def _from_z_to(normals):
    """The smallest rotations that take +z to unit normals: (N, 3) -> (N, 4) wxyz."""
    x, y, z = normals.T
    quats = np.stack([1.0 + z, -y, x, np.zeros_like(z)], axis=1)
    length = np.linalg.norm(quats, axis=1, keepdims=True)
    return np.where(length > 1e-4, quats / np.maximum(length, 1e-4), np.array([0, 1, 0, 0], normals.dtype))


def _then_about_axis(quats, axis, angle):
    """quats * (rotation by `angle` about coordinate axis 1, 2 or 3 of the rotated frame): (N, 4) wxyz."""
    sin, cos = np.sin(angle / 2), np.cos(angle / 2)
    turned = cos[:, None] * quats
    after, before = axis % 3 + 1, (axis + 1) % 3 + 1
    turned[:, 0] -= sin * quats[:, axis]
    turned[:, axis] += sin * quats[:, 0]
    turned[:, after] += sin * quats[:, before]
    turned[:, before] -= sin * quats[:, after]
    return turned
