"""The opacity field in plain NumPy float64: slow, short, no tiles, no search steps. The tests' oracle."""

import numpy as np
from rasterize_reference import project

from splat2mesh.base.arrays import Floats
from splat2mesh.render.footprints import MIN_ALPHA, NEAR
from splat2mesh.render.levelsearch import FARTHEST_Q, SPREAD_FROM, SPREAD_TO
from splat2mesh.render.opacityfield import ENOUGH, FIELD_LEVEL, LIST, MAX_ALPHA, FieldDepth
from splat2mesh.render.view import View
from splat2mesh.splats.splats import Splats


def field_depth_reference(splats: Splats, view: View, near: float = NEAR, level: float = FIELD_LEVEL) -> FieldDepth:
    """`field_depth`, every splat against every pixel. Same arguments, same FieldDepth."""
    field = OpacityField(splats, view, near)
    depth, behind, before = (field.reach(at) for at in (level, float(SPREAD_TO), float(SPREAD_FROM)))
    length = np.linalg.norm(field.normal, axis=-1, keepdims=True)
    depth[(depth <= near) | (length[..., 0] == 0)] = np.nan
    found = np.isfinite(depth)
    normal = np.where(found[..., None], field.normal / np.maximum(length, 1e-30), 0) @ view.camera_from_world[:3, :3]
    spread = np.where(found, np.where(np.isnan(behind), field.last, behind) - before, np.nan)
    alpha = 1 - field.transmittance
    color = field.color / np.maximum(alpha, 1e-6)[..., None]
    return FieldDepth(*(a.astype(np.float32) for a in (depth, normal, spread, color, alpha)))


class OpacityField:
    """The Gaussians along every pixel's ray. H, W are the view's size, LIST Gaussians a pixel at most.

    alpha, peak, precision: (H, W, LIST) opacity at the peak (0 after the last), its camera z, and 1 / sigma^2.
    transmittance (H, W); color (H, W, 3) premultiplied; normal (H, W, 3) in the camera's frame: of all that is drawn.
    """

    def __init__(self, splats: Splats, view: View, near: float = NEAR) -> None:
        center, covariance, z = project(splats, view)
        pixels = np.stack(np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5), axis=-1)
        turn, shift = view.camera_from_world[:3, :3], view.camera_from_world[:3, 3]
        rays, means = view.ray_directions() @ turn.T, splats.means.astype(np.float64) @ turn.T + shift
        axes = turn @ splats.rotation_matrices().astype(np.float64)
        precisions = axes / splats.scales.astype(np.float64)[:, None] ** 2 @ axes.swapaxes(1, 2)
        colors = splats.colors_toward(view.center)

        size = view.height, view.width
        self.alpha, self.peak, self.precision = (np.zeros((*size, LIST)) for _ in range(3))
        self.transmittance, count = np.ones(size), np.zeros(size, int)
        self.color, self.normal = np.zeros((*size, 3)), np.zeros((*size, 3))
        for i in np.argsort(z.astype(np.float32), kind="stable"):
            if z[i] <= near:
                continue
            offset = pixels - center[i]
            q = np.einsum("hwi,ij,hwj->hw", offset, np.linalg.inv(covariance[i]), offset)
            alpha = np.minimum(splats.opacities[i] * np.exp(-q / 2), MAX_ALPHA)
            alpha[(alpha < MIN_ALPHA) | (self.transmittance < ENOUGH)] = 0
            weight = self.transmittance * alpha
            self.transmittance *= 1 - alpha
            # Along the ray t r: the exponent is a parabola in t, and its slope across the ray is the normal.
            slope = rays @ precisions[i]
            precision = (slope * rays).sum(axis=-1)
            self.color += weight[..., None] * colors[i]
            self.normal -= weight[..., None] * slope / np.linalg.norm(slope, axis=-1, keepdims=True)
            rows, columns = np.nonzero((weight > MIN_ALPHA) & (count < LIST))
            at = rows, columns, count[rows, columns]
            self.alpha[at], self.precision[at] = alpha[rows, columns], precision[rows, columns]
            self.peak[at] = (slope @ means[i] / precision)[rows, columns]
            count[rows, columns] += 1
        self.last = np.where(count > 0, np.where(self.alpha > 0, self.peak, -np.inf).max(axis=-1), 0)

    def opacity(self, t: Floats) -> Floats:
        """Opacity in front of camera z t: (H, W) -> (H, W)."""
        q = np.maximum(self.peak - t[..., None], 0) ** 2 * self.precision
        return 1 - np.prod(1 - self.alpha * np.exp(-q / 2) * (q < FARTHEST_Q), axis=-1)

    def reach(self, level: float) -> Floats:
        """Camera z at which the opacity reaches `level`, by bisection; NaN where it never does: (H, W)."""
        listed = self.alpha > 0
        reached = self.opacity(self.last) >= level
        sigma = 1 / np.sqrt(np.where(listed, self.precision, 1))
        low = np.where(reached, np.where(listed, self.peak - 4 * sigma, np.inf).min(axis=-1), 0)
        high = np.where(reached, self.last, 0)
        for _ in range(60):
            middle = (low + high) / 2
            below = self.opacity(middle) < level
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.where(reached, high, np.nan)
