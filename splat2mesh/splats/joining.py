"""Several splats joined into one, in little more memory than the result takes."""

import numpy as np
from numpy.typing import NDArray

from .facts import common
from .splats import Splats


def joined(parts: list[Splats]) -> Splats:
    """Join several Splats to one, part after part; lower degrees get harmonics of zero.

    parts: at least one. It is emptied meanwhile, so the memory of a part without other references is free again once
    its rows are copied: at the peak there are the whole and one part of the largest field. Returns Splats: rows are
    marked as environment where their part marks them; where no part does, there is no mark. Parts of other offsets are
    moved to the common one.
    """
    if len(parts) == 1:
        return parts.pop()
    starts = np.cumsum([0, *map(len, parts)])
    total, coefficients = int(starts[-1]), max(part.sh.shape[1] for part in parts)
    # Pages of zeros are taken as they are written to: the whole grows while the parts go.
    shapes = {"means": (3,), "scales": (3,), "quats_wxyz": (4,), "opacities": (), "sh": (coefficients, 3)}
    environment = np.zeros(total, bool) if any(part.environment is not None for part in parts) else None
    arrays = (np.zeros((total, *shape), np.float32) for shape in shapes.values())
    facts = common([part.facts for part in parts])
    whole = Splats(**dict(zip(shapes, arrays, strict=True)), environment=environment, facts=facts)
    while parts:
        part = parts.pop()
        rows = slice(int(starts[len(parts)]), int(starts[len(parts) + 1]))
        for name in ("scales", "quats_wxyz", "opacities"):
            getattr(whole, name)[rows] = getattr(part, name)
        whole.means[rows] = at_offset(part, facts.offset)
        whole.sh[rows, : part.sh.shape[1]] = part.sh
        if whole.environment is not None and part.environment is not None:
            whole.environment[rows] = part.environment
    return whole


def at_offset(
    splats: Splats,
    offset: tuple[float, float, float],  # of the new means
) -> NDArray[np.float32]:
    """Return the means of splats beside another offset than theirs. Returns (N, 3) float32."""
    if splats.facts.offset == offset:
        return splats.means
    apart = np.subtract(splats.facts.offset, offset)
    return (splats.means.astype(np.float64) + apart).astype(np.float32)
