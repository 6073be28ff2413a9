"""Direct light on a white scene, as the light of the capture and its check both need it."""

import math

import numpy as np


def direct_light(
    occluder,  # Occluder
    transfer,  # (V, K) of the white scene
    environment,  # Environment, scene frame
    sunlit=None,  # Suns -> their light on the white scene, (V, 3) float32, through leaves as the transfer has it
):
    """Direct light on the white scene, (V, 3) float32, not negative: in the unit of the environment."""
    from ..light.sun_split import split
    from ..transfer.sunlight import sunlight

    bands = math.isqrt(transfer.shape[1])
    rest, suns = split(environment, bands)
    direct = transfer @ rest.sh(bands).astype(np.float32)
    if len(suns):
        direct += sunlight(occluder, slice(None), suns) if sunlit is None else sunlit(suns)
    return np.maximum(direct, np.float32(0.0), out=direct)
