"""Draw the page that `relight --format web` wrote: under two lights, its albedo, and before and after, in Chromium.

PYTHONPATH=tests/support python scripts/page_picture.py OUT.jpg PAGE.html
"""

import json
import sys
import time
from pathlib import Path

import imageio.v3 as iio
import numpy as np
from browser import Browser

SIZE, FRAMES, WAIT_S = (1000, 600), 8, 600.0

STATES = (
    {"view": "relit", "light": 0, "turn": 0},
    {"view": "relit", "light": 1, "turn": 60},
    {"view": "albedo"},
    {"view": "relit", "light": 0, "turn": 120, "compare": True},
)
"""Lights of the page, row by row; the light that it was written for is number 0."""

FRAME = "() => new Promise((done) => requestAnimationFrame(() => done()))"


def shown(page, state):
    """(H, W, 3) uint8 of the page in a state, once its splats are sorted."""
    before = page.run("relight.drawn")
    page.run(f"relight.set({json.dumps(state)})")
    page.wait(f"relight.drawn > {before}", WAIT_S)
    for _ in range(FRAMES):
        page.run(f"({FRAME})()", WAIT_S)
    time.sleep(2.0)  # the picture on the screen is the browser's, a little later
    return page.picture()


def main(out, file):
    """Write the picture, half as large as the four windows."""
    with Browser(f"file://{Path(file).resolve()}#renderer=webgl", SIZE) as page:
        page.wait("window.relight && relight.drawn", WAIT_S)
        pictures = [shown(page, state) for state in STATES]
        if page.said:
            raise RuntimeError(f"the page said {page.said}")
    rows = [np.concatenate(pictures[i : i + 2], axis=1) for i in (0, 2)]
    image = np.concatenate(rows)
    height, width = image.shape[:2]
    image = image.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3)).astype(np.uint8)
    iio.imwrite(out, image, quality=85)


if __name__ == "__main__":
    main(*sys.argv[1:])
