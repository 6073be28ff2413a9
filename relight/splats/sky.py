"""The sky of a relit splat: its far background shows the new environment, stays as it was, or goes.

Far splats are a picture of the light of the capture day. Each takes the radiance that arrives from where it stands, as
seen from the middle of the scene, and no longer depends on the view.
"""

import numpy as np

from splat2mesh.base.errors import InputError
from splat2mesh.splats.splats import SH_C0, Splats

from ..light.tonemap import tone_map

SKIES = ("new", "keep", "drop")
"""What becomes of the far background of a relit splat."""


def under_sky(
    splats,  # Splats, relit, every row of the source
    rows,  # (M,) which of them are far background
    environment,  # Environment, turned as the scene is lit
    scene_from_splat,  # (4, 4)
    exposure,  # shown = radiance * exposure
    choice="new",  # of SKIES; "keep" is for the caller not to ask
    eye=None,  # (3,) from where they are seen, in the splats' frame; the middle of the others without
):
    """The Splats with the far ones in the new sky, or with opacity 0. Raises InputError for another choice
    and for rows that are not there."""
    if choice not in SKIES:
        raise InputError(f"the sky must be one of {', '.join(SKIES)}, found {choice!r}")
    if choice == "keep" or not len(rows):
        return splats
    if not 0 <= rows.min() <= rows.max() < len(splats):
        raise InputError(f"the scene's far background reaches to splat {rows.max()}, there are {len(splats)}")
    if choice == "drop":
        opacities = splats.opacities.copy()
        opacities[rows] = 0.0
        return Splats(splats.means, splats.scales, splats.quats_wxyz, opacities, splats.sh)
    if eye is None:
        near = np.delete(splats.means, rows, axis=0)
        eye = np.median(near[np.isfinite(near).all(axis=1)], axis=0) if len(near) else np.zeros(3)
    matrix = np.asarray(scene_from_splat, np.float64)[:3, :3]
    shown = environment.lookup((splats.means[rows] - eye) @ matrix.T) * np.float32(exposure)
    sh = splats.sh.copy()
    sh[rows] = 0.0
    sh[rows, 0] = (tone_map(shown) - np.float32(0.5)) / np.float32(SH_C0)
    return Splats(splats.means, splats.scales, splats.quats_wxyz, splats.opacities, sh)
