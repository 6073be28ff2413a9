"""Measurements on a source and the scene made from it: the captured sky, volumes, and their optical depth."""

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..base.arrays import Floats, Integers, Mask, Matrix4, Points
from ..render.thickness import optical_depth
from ..scene.leaves import FEW
from ..scene.measured import Measured
from ..splats.cleaning import usable
from ..splats.splats import Splats
from .captured_sky import captured_sky
from .volume import SOLID, splat_volume, vertex_volume

LEAST_SHARE = 0.005
"""Part of the vertices that have a volume of more than FEW, from which the depth of leaves and grass is measured."""


SHELL, SHELL_SHARE = 0.03, 90.0
"""Distance of an object's leafy splats from its mesh, in diagonals of the mesh, and the percentile of them that must be
farther: up to there they are the fuzz of a closed surface. A guitar, whose dark gloss was trained as splats without
order, has .012; Gaussians that fill a ball evenly have .15. Set between these two and fitted to nothing else; a plant
whose every leaf is meshed would pass for a shell."""


def measured_of(
    splats: Splats,
    background: Integers | Mask,
    vertices: Points,
    scene_from_splat: Matrix4,
    eyes: Sequence[ArrayLike] = (),
    is_object: bool = False,
) -> Measured:
    """Return what is measured on a source and the scene made of it; rows of no use, by `usable`, are no volume.

    splats: as read, every row of the source. background: (M,) int or (N,) bool, rows that are far background. vertices:
    (V, 3) float, of the scene, scene frame. scene_from_splat: (4, 4) float. eyes: sequence of (3,) float, where the
    capture stood, scene frame; the middle of the rest without. is_object: whether the capture is of an object with
    neither ground nor far background around it: a closed surface has no leaves then.
    """
    far = np.zeros(len(splats), bool)
    far[background] = True
    rows = np.flatnonzero(usable(splats)[0])
    drawn, far_drawn = splats.take(rows), far[rows]
    near = np.flatnonzero(~far_drawn)
    subject = drawn.take(near)
    volume = np.zeros(len(splats), np.float32)
    measured = splat_volume(subject)
    volume[rows[near]] = measured
    back = np.linalg.inv(np.asarray(scene_from_splat, np.float64))
    eye = None if not len(eyes) else np.mean(np.asarray(eyes, np.float64), axis=0) @ back[:3, :3].T + back[:3, 3]
    sky = captured_sky(drawn, far_drawn, scene_from_splat, eye)
    points = vertices @ back[:3, :3].T + back[:3, 3]
    if is_object and is_shell(points, subject, measured):
        measured = np.zeros_like(measured)
        volume[rows[near]] = measured
    found = Measured(sky, volume, vertex_volume(points, subject, measured))
    if not (found.foliage > FEW).mean() > LEAST_SHARE:
        return found
    return found._replace(depth=optical_depth(subject, measured, scene_from_splat))


def is_shell(points: Points, splats: Splats, volume: Floats) -> bool:
    """Whether the splats of a volume lie along the surface of an object, and do not fill it. points: (V, 3) of the
    mesh, in the splats' frame. volume: (N,) of the splats."""
    leafy = (volume > FEW) & (splats.opacities > SOLID)
    if not leafy.any() or not len(points):
        return True
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    depth, _ = scipy.spatial.cKDTree(points).query(splats.means[leafy], workers=-1)
    return bool(np.percentile(depth, SHELL_SHARE) < SHELL * diagonal)
