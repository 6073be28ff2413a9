"""Whether a splat was captured from one side: it is sharp from there and a blur from behind, in depth and in colour."""

import numpy as np

from ..base.arrays import Directions, Floats, Vector
from ..base.sphere import level_directions

TURNS = 24
"""Horizontal directions tried, all around: as the front here, and for a picture."""

HIGHEST = 0.75
"""Largest sine of the elevation of a view that counts: from above everything looks alike."""

FACING = 0.5
"""Cosine of the angle about the vertical up to which a view is in front, and beyond which on the other side behind."""

SHARPEST_BEHIND = 0.25
"""Quantile of the views from behind that must be blurred: nearly all of them."""

CONTRAST = 1.6
"""Blur from behind over blur from the front, above which a capture is one-sided. A row of cameras before a kitchen
has 1.9 to 3.4, and a shed behind a fence 2.0 to 2.7. Thirteen objects and grounds captured from around have .9 to 1.25,
a relief with a back among them. A generated nook, whose outer walls are plain, has 1.6 by its pictures, but 1.0 by its
surfaces alone, where kitchen and shed have 2.2."""


SUSPECTED = 1.25
"""The same in a sketch of 20,000 Gaussians, which decides only whether a clearer one is looked at: two one-sided
captures have 1.3 and 2.3 there, four objects .85 to 1.2 and one 1.5."""


def sharp_side(
    directions: Directions,  # (N, 3) unit, from the splat to views around it
    blur: Floats,  # (N,) of what each of them shows: how fuzzy its surfaces are, or that over detail; inf for nothing
    up: Vector,  # (3,) unit
    least: float = CONTRAST,
) -> Vector | None:
    """Return the horizontal direction (3,) that a splat was captured from, or None where there is no one side. least:
    blur from behind over blur from the front that makes one."""
    height = directions @ up
    used = (np.abs(height) < HIGHEST) & np.isfinite(blur)
    flat = directions[used] - height[used, None] * up
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    blurred = blur[used]
    towards = level_directions(up, TURNS)
    contrasts = np.array([_contrast(flat @ toward, blurred) for toward in towards])
    if contrasts.max() < least:
        return None
    front = towards[contrasts >= least].sum(axis=0)
    length = float(np.linalg.norm(front))
    return front / length if length > 0.5 else towards[int(contrasts.argmax())]


def _contrast(facing: Floats, blur: Floats) -> float:
    """Blur from behind over that from the front; 0 without either. facing: (N,) cosines about the vertical."""
    seen, behind = blur[facing > FACING], blur[facing < -FACING]
    if not len(seen) or not len(behind):
        return 0.0
    return float(np.quantile(behind, SHARPEST_BEHIND) / max(float(np.median(seen)), 1e-12))
