"""The ground under an object: what the object hides of the light above, for the page to shadow it under any light."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FILE = "ground.bin"


class ShadowedGround(NamedTuple):
    """Level ground, scene frame, and what is hidden at its points.

    height: its y. middle: (2,) x and z of the middle of a square of points. reach: half of its side. steps: (S,)
    float32, positions of rows and columns of points along the side, -1 to 1. directions: (K, 3) float32 unit, of the
    upper hemisphere. hidden: (K, S * S) bool, whether a point sees the object in a direction, rows along z. shared:
    the number of directions that share the light of a texel. blur: standard deviation of shadows, in points.
    """

    height: float
    middle: NDArray[np.float64]
    reach: float
    steps: NDArray[np.float32]
    directions: NDArray[np.float32]
    hidden: NDArray[np.bool_]
    shared: int
    blur: float

    def tobytes(self) -> bytes:
        """Content of FILE: steps, directions, then for each direction the changes of its row in `hidden`."""
        edges = _bytes_of_numbers(_gaps(self.hidden))
        return self.steps.astype("<f4").tobytes() + self.directions.astype("<f4").tobytes() + edges

    def described(self) -> dict[str, Any]:
        """Its entry in live.json."""
        return {
            "file": FILE,
            "bytes": len(self.tobytes()),
            "height": self.height,
            "middle": np.asarray(self.middle, np.float64).tolist(),
            "reach": self.reach,
            "side": len(self.steps),
            "directions": len(self.directions),
            "shared": self.shared,
            "blur": self.blur,
        }


def _gaps(hidden: NDArray[np.bool_]) -> NDArray[np.int64]:
    """For each row the number of its changes between open and hidden, beginning open, then the distance of each from
    the one before, the first from the start of the row."""
    changes = np.diff(np.pad(hidden.astype(np.int8), ((0, 0), (1, 0))), axis=1) != 0
    parts = []
    for row in changes:
        places = np.flatnonzero(row)
        parts.append(np.concatenate([[len(places)], np.diff(places, prepend=0)]))
    return np.concatenate(parts) if parts else np.zeros(0, np.int64)


def _bytes_of_numbers(numbers: NDArray[np.int64]) -> bytes:
    """Numbers of up to 21 bits, seven to a byte, low ones first; a byte with its high bit set goes on in the next."""
    low, middle, high = numbers & 127, numbers >> 7 & 127, numbers >> 14
    cells = np.stack([low | (numbers > 127) << 7, middle | (numbers > 16383) << 7, high], axis=1).astype(np.uint8)
    return cells[np.stack([numbers >= 0, numbers > 127, numbers > 16383], axis=1)].tobytes()
