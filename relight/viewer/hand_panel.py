"""Maps on the window while the captured light is set by hand: the offered lights, and the present one with its sun."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .canvas import BAR, CHIP, DARK, DIM, MARGIN, ON, TEXT, Canvas
from .hand_bench import HandBench
from .hand_tool import OFFER, SUN_MAP, place_on_map

CELL = 3
LARGE = 2 * CELL
"""Sides of a texel of a map, in units: of an offered light, and of the present one, whose sun is dragged."""

GAP = 10
LEFT = LINE = MARGIN
"""Units: between maps, from the left edge, and the height of a name."""

Hot = Callable[..., None]
"""((left, base, width, height), name): an area that takes the mouse."""


def draw_hand(canvas: Canvas, bench: HandBench, top: float, hot: Hot) -> None:
    """Draw the maps below a height: the present light first, then the offered ones."""
    if not bench.ready:
        return
    present = bench.map_of(None)
    width, height = LARGE * present.shape[1], LARGE * present.shape[0]
    base = top - GAP - LINE - height
    names = [_name(bench, number) for number in range(len(bench.offered))]
    wide = max(width, *(CELL * present.shape[1] + GAP + canvas.width(name) for name in names))
    small = CELL * present.shape[0] + GAP
    low = base - GAP - len(names) * small
    canvas.rectangle(LEFT - 8, low, wide + 16, top - low, BAR)
    canvas.text(LEFT, base + height + 5, "captured light: drag its sun", TEXT)
    _map(canvas, present, LEFT, base, LARGE)
    right, up = place_on_map(bench.hand.azimuth_deg, bench.hand.height_deg)
    if bench.hand.sun_share > 0.0:
        x, y = LEFT + right * width, base + up * height
        canvas.rectangle(x - 5, y - 5, 10, 10, (*DARK, 255))
        canvas.rectangle(x - 3, y - 3, 6, 6, ON)
    hot((LEFT, base, width, height), SUN_MAP)
    for number, name in enumerate(names):
        base -= small
        shown, used = bench.map_of(number), number == bench.number
        across, tall = CELL * shown.shape[1], CELL * shown.shape[0]
        canvas.rectangle(LEFT - 2, base - 2, across + 4, tall + 4, ON if used else CHIP)
        _map(canvas, shown, LEFT, base, CELL)
        canvas.text(LEFT + across + GAP, base + tall / 2 - 4, name, TEXT if used else DIM)
        hot((LEFT - 2, base - 2, wide, tall + 4), f"{OFFER}{number}")


def _name(bench: HandBench, number: int) -> str:
    entry = bench.offered[number].entry
    if entry.by_hand:
        return f"{number + 1}  {entry.name}"
    share = 100.0 * entry.share
    return f"{number + 1}  {entry.name}, " + (f"{share:.0f} %" if share >= 0.5 else "below 1 %")


def _map(canvas: Canvas, shown: NDArray[np.uint8], left: float, base: float, cell: float) -> None:
    """Draw a map, (rows, columns, 3) uint8, as runs of one colour along its rows."""
    rows, columns = shown.shape[:2]
    for row in range(rows):
        start = 0
        for column in range(1, columns + 1):
            if column == columns or (shown[row, column] != shown[row, start]).any():
                red, green, blue = (int(each) for each in shown[row, start])
                place = left + start * cell, base + (rows - 1 - row) * cell
                canvas.rectangle(*place, (column - start) * cell, cell, (red, green, blue, 255))
                start = column
