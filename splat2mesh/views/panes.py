"""Sky that training left in or near the panes of a room's windows: splats of it that look like surfaces.

A photograph of a room shows the sky in its windows white, and white has no parallax that training could see. So some of
it hangs right behind a pane, opaque and metres wide, where it would be meshed and shut the window.
"""

from collections.abc import Sequence

import numpy as np

from ..base.arrays import Bounds, Mask
from ..render.opacitygrid import BEFORE, OpacityGrid
from ..scene.color import CLIPPED_SRGB
from ..splats.splats import SH_C0, Splats
from .eyes import Eye

LEAST_OPEN, LEAST_SKY = 0.9, 0.2
"""Part of the eyes to which a splat shows that see nothing of the room behind it, and that see the far background
there. Of the white, opaque splats of a trained parlour 21 of 26 beyond its walls exceed the first, and 14 of 1,776
within them, which hang in the panes; of two generated lounges all 1,332 outside but 10, and 13 of 1,998 inside. Both
were chosen on these three; of a trained lounge, held back, they find the windows and neither frames nor lamp."""


def sky_in_panes(splats: Splats, far: Mask, bounds: Bounds, eyes: Sequence[Eye]) -> Mask:
    """Which splats are sky that hangs before the far background of a room, (N,) bool.

    splats: cleaned Splats. far: (N,) bool, their far background. bounds: (2, 3) box of the others. eyes: list of Eye
    in the room. They are white in all channels, and behind them the eyes see no surface, only the background.
    """
    found = np.zeros(len(splats), bool)
    # A lamp, the sky, or paper in the sun.
    white = ~far & ((splats.sh[:, 0] * np.float32(SH_C0) + np.float32(0.5)).min(axis=1) > CLIPPED_SRGB)
    rows = np.flatnonzero(white)
    if not len(rows) or not far.any() or not len(eyes):
        return found
    grid = OpacityGrid.around(splats.take(np.flatnonzero(~white)), bounds)
    shown, free, sky = (np.zeros(len(rows), np.int64) for _ in range(3))
    for eye in eyes:
        way = splats.means[rows].astype(np.float64) - eye.center
        length = np.maximum(np.linalg.norm(way, axis=1), 1e-30)
        reached, _, level = (each[0] for each in grid.march(eye.center[None], way / length[:, None]))
        surface, met = np.isfinite(reached) & (level == 0), np.isfinite(reached)
        visible = ~(surface & (reached < BEFORE * length))
        shown += visible
        free += visible & ~surface
        sky += visible & met & ~surface
    found[rows] = (free > LEAST_OPEN * shown) & (sky > LEAST_SKY * shown)
    return found
