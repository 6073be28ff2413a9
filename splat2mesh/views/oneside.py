"""Whether a splat was captured from one side: it is sharp from there and a blur from behind."""

import numpy as np

from ..base.arrays import Directions, Floats, Vector

TURNS = 24
"""Directions tried as the front, all around."""

HIGHEST = 0.75
"""Largest sine of the elevation of a view that counts: from above everything looks alike."""

FACING = 0.5
"""Cosine of the angle about the vertical up to which a view is in front, and beyond which on the other side behind."""

SHARPEST_BEHIND = 0.25
"""Quantile of the views from behind that must be blurred: nearly all of them."""

CONTRAST = 1.6
"""Blur from behind over blur from the front, from which on a capture is one-sided. A row of cameras in front of a
kitchen has 3.0 and a shed captured from its front 1.9; twelve objects and grounds captured from around have .9 to 1.3,
a relief with a back 1.0."""


def sharp_side(
    directions: Directions,  # (N, 3) unit, from the splat to views around it
    fuzziness: Floats,  # (N,) of what each of them shows, inf where it shows nothing
    up: Vector,  # (3,) unit
) -> Vector | None:
    """Return the horizontal direction (3,) that a splat was captured from, or None where there is no one side."""
    height = directions @ up
    used = (np.abs(height) < HIGHEST) & np.isfinite(fuzziness)
    flat = directions[used] - height[used, None] * up
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    fuzz = fuzziness[used]
    ahead = np.linalg.svd(up[None])[2][1]
    side = np.cross(up, ahead)
    best, front = 0.0, None
    for turn in np.arange(TURNS) * 2 * np.pi / TURNS:
        toward = np.cos(turn) * ahead + np.sin(turn) * side
        facing = flat @ toward
        seen, behind = fuzz[facing > FACING], fuzz[facing < -FACING]
        if not len(seen) or not len(behind):
            continue
        contrast = np.quantile(behind, SHARPEST_BEHIND) / max(float(np.median(seen)), 1e-12)
        if contrast > best:
            best, front = contrast, toward
    return front if best >= CONTRAST else None
