"""Views of the far background of an open capture from within its foreground."""

import numpy as np

from ..base.arrays import Vector
from ..base.sphere import level_directions
from ..render.view import View
from ..splats.splats import Splats
from ..views.eyes import Eye, around
from ..views.viewpoints import bounds_of, near_plane

EYES = 4
"""Places to look around from."""


def views_from_within(foreground: Splats, pixels: int, up: Vector) -> list[View]:
    """Views all around from places in the middle of a foreground (Splats): a list of View of `pixels` squared. up: (3,)
    unit, the up direction in the splat's frame."""
    bounds = bounds_of(foreground)
    centers = bounds.mean(axis=0) + np.ptp(bounds, axis=0) / 4.0 * level_directions(up, EYES)
    return around([Eye(center, near_plane(bounds)) for center in centers], pixels, up)[0]
