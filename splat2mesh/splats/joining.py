"""Several splats joined into one, in little more memory than the result takes."""

import numpy as np

from .splats import Splats


def joined(parts: list[Splats]) -> Splats:
    """Join several Splats to one, part after part; lower degrees get harmonics of zero.

    Parameters
    ----------
    parts : list of Splats
        At least one. It is emptied meanwhile, so the memory of a part without other references is free again once
        its rows are copied: at the peak there are the whole and one part of the largest field.

    Returns
    -------
    Splats
        Rows are marked as environment where their part marks them; where no part does, there is no mark.
    """
    if len(parts) == 1:
        return parts.pop()
    starts = np.cumsum([0, *map(len, parts)])
    total, coefficients = int(starts[-1]), max(part.sh.shape[1] for part in parts)
    # Pages of zeros are taken as they are written to: the whole grows while the parts go.
    shapes = {"means": (3,), "scales": (3,), "quats_wxyz": (4,), "opacities": (), "sh": (coefficients, 3)}
    environment = np.zeros(total, bool) if any(part.environment is not None for part in parts) else None
    arrays = (np.zeros((total, *shape), np.float32) for shape in shapes.values())
    whole = Splats(**dict(zip(shapes, arrays, strict=True)), environment=environment)
    while parts:
        part = parts.pop()
        rows = slice(int(starts[len(parts)]), int(starts[len(parts) + 1]))
        for name in ("means", "scales", "quats_wxyz", "opacities"):
            getattr(whole, name)[rows] = getattr(part, name)
        whole.sh[rows, : part.sh.shape[1]] = part.sh
        if whole.environment is not None and part.environment is not None:
            whole.environment[rows] = part.environment
    return whole
