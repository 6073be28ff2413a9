"""Captures of generated scenes under photographed lights, as arrays: what an estimate needs, and the truth.

A scene is meshed once, from splats laid out as training leaves them. Its splats take their true colours under each
light, exposed as a photographer would, some with a tone curve; vertices take the colours of the splats around, and
the sky is seen where the capture saw it, clipped where it is bright. So the errors of mesh, blur and clipping are those
of the pipeline, and a hundred captures take minutes, not days.
"""

from pathlib import Path

import numpy as np

PARTS = {
    "fit": {"garden": (3, 5, 8), "nook": (1, 4), "object": (1, 2, 3), "tabletop": (1, 2), "room": (1, 2)},
    "choose": {"garden": (11, 2), "street": (1,), "nook": (2, 9), "figure": (1,), "object": (4,), "tabletop": (3,)},
    "test": {"courtyard": (1,), "still-life": (1,), "machine": (1,), "forest": (1,), "white-sky": (1,), "nook": (6,)},
}
"""Kinds of scenes and their seeds. Lights are split as well, by `part_of`."""


def part_of(name):
    """The part that a light belongs to: every light has one, by its name."""
    return ("fit", "fit", "choose", "test")[sum(name.encode()) % 4]


def load(folder, part):
    """Captures of a part, dicts of arrays, in the order of their names."""
    found = []
    for kind, seeds in PARTS[part].items():
        for seed in seeds:
            for path in sorted(Path(folder).glob(f"{kind}{seed}-*.npz")):
                with np.load(path) as file:
                    found.append({name: file[name] for name in file.files})
    return found
