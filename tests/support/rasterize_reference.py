"""The rasteriser in plain NumPy float64: slow, short, no tiles, no bounds. The tests' oracle."""

import numpy as np
from scipy.spatial.transform import Rotation

from splat2mesh.base.arrays import Floats
from splat2mesh.render.footprints import DILATION, GUARD_BAND, MIN_ALPHA, NEAR
from splat2mesh.render.rasterize import MAX_ALPHA, MIN_TRANSMITTANCE, Rendering
from splat2mesh.render.view import View
from splat2mesh.splats.splats import Splats


def rasterize_reference(splats: Splats, view: View, near: float = NEAR) -> Rendering:
    """`rasterize`, every splat against every pixel. Same arguments, same Rendering. Time N x H x W: meant for some
    hundred splats and some thousand pixels."""
    center, covariance, depth = project(splats, view)
    color = splats.colors_toward(view.center)
    pixels = np.stack(np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5), axis=-1)

    image = np.zeros((view.height, view.width, 3))
    depth_median = np.full((view.height, view.width), np.nan)
    transmittance = np.ones((view.height, view.width))
    for i in np.argsort(depth.astype(np.float32), kind="stable"):
        if depth[i] <= near:
            continue
        offset = pixels - center[i]
        q = np.einsum("hwi,ij,hwj->hw", offset, np.linalg.inv(covariance[i]), offset)
        alpha = np.minimum(splats.opacities[i] * np.exp(-q / 2), MAX_ALPHA)
        alpha[(alpha < MIN_ALPHA) | (transmittance < MIN_TRANSMITTANCE)] = 0
        weight, after = transmittance * alpha, transmittance * (1 - alpha)
        image += weight[..., None] * color[i]
        depth_median[(transmittance > 0.5) & (after <= 0.5)] = depth[i]
        transmittance = after

    return Rendering(*(a.astype(np.float32) for a in (image, 1 - transmittance, depth_median)))


def project(splats: Splats, view: View) -> tuple[Floats, Floats, Floats]:
    """Centres (N, 2) in pixels, covariances (N, 2, 2) in px^2 and camera z (N,) of the splats in the image.

    Covariance J W Sigma W^T J^T plus the dilation, J the Jacobian of the pinhole projection at the splat's
    centre, held constant outside the image and its guard band (Zwicker et al. 2002, equations 29 and 31;
    Kerbl et al. 2023, section 4).
    """
    world_to_camera = view.camera_from_world[:3, :3]
    points = splats.means.astype(np.float64) @ world_to_camera.T + view.camera_from_world[:3, 3]
    depth = points[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = points[:, :2] / depth[:, None]
    focal, principal = np.array([view.fx, view.fy]), np.array([view.cx, view.cy])
    size = np.array([view.width, view.height])
    band = GUARD_BAND * size / (2 * focal)
    slope = np.clip(ratio, -principal / focal - band, (size - principal) / focal + band)

    axes = Rotation.from_quat(splats.quats_wxyz.astype(np.float64), scalar_first=True).as_matrix()
    axes = axes * splats.scales[:, None, :].astype(np.float64)
    jacobian = np.zeros((len(depth), 2, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        jacobian[:, 0, 0], jacobian[:, 1, 1] = focal[0] / depth, focal[1] / depth
        jacobian[:, :, 2] = -focal * slope / depth[:, None]
        half = jacobian @ world_to_camera @ axes
        covariance = half @ half.transpose(0, 2, 1) + DILATION * np.eye(2)
    return ratio * focal + principal, covariance, depth
