"""Direct light on a white scene, as the light of the capture and its check both need it."""

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Transfer

from ..transfer.occluder import Occluder
from ..transfer.transport import Sunlit

if TYPE_CHECKING:
    from ..light.environment import Environment


def direct_light(
    occluder: Occluder,
    transfer: Transfer,  # (V, K) of the white scene
    environment: "Environment",  # scene frame
    sunlit: Sunlit | None = None,  # what suns add; by default `sunlight` of the occluder
    rows: Indices | None = None,  # (N,) vertices that are asked for; all without
) -> NDArray[np.float32]:
    """Direct light on the white scene, (V, 3) or (N, 3) float32, not negative: in the unit of the environment."""
    from ..light.sun_split import split
    from ..transfer.sunlight import sunlight

    bands = math.isqrt(transfer.shape[1])
    rest, suns = split(environment, bands)
    direct = transfer @ rest.sh(bands).astype(np.float32)
    if len(suns):
        added = sunlight(occluder, slice(None), suns) if sunlit is None else sunlit(suns, rows)
        direct = direct if added is None else np.add(direct, added, out=direct)
    direct = direct if rows is None else direct[rows]
    return np.maximum(direct, np.float32(0.0), out=direct)
