"""Two passes that run for every picture: coefficients to radiance, and radiance to the bytes of a screen.

The second is compiled, since NumPy takes many times as long for it.
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_batches, in_slices, read_only
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear

from ..light.tonemap import DESATURATION, SHOULDER_START

_STEPS = 2**14
"""Of the table of the sRGB curve, whose steepest part rises by 0.2 bytes between two of them."""

SRGB_BYTES = bytes_from_unit(srgb_from_linear(np.linspace(0.0, 1.0, _STEPS)))


def harmonic_light(
    transfer: NDArray,  # (V, K) float32 of the white scene
    coefficients: NDArray,  # (K', 3) of radiance, K' at least K and K''
    albedo: NDArray | None = None,  # (V, 3) float32; white without
    bounced: NDArray | None = None,  # (3, V, K'') float32, what bounces add for each colour; it holds the albedo
) -> NDArray:
    """Exit radiance (V, 3) float32: albedo * max(transfer c, 0) + bounced c, and nothing below 0."""
    columns, radiance = np.asarray(coefficients, np.float32), np.zeros((len(transfer), 3), np.float32)

    def light(part: slice) -> None:
        found = np.maximum(transfer[part] @ columns[: transfer.shape[1]], 0.0)
        if albedo is not None:
            found *= albedo[part]
        for channel, more in enumerate(() if bounced is None else bounced):
            found[:, channel] += more[part] @ columns[: more.shape[1], channel]
        np.maximum(found, 0.0, out=radiance[part])

    in_batches(light, len(transfer))
    return radiance


def display_bytes(
    radiance: NDArray,  # (V, 3) float32 linear
    exposure: float,  # display value per unit of radiance
) -> NDArray:
    """sRGB bytes (V, 3) as of `bytes_from_unit(tone_map(radiance * exposure))`, up to one in the last place.

    Source: Khronos PBR Neutral, as `relight.light.tonemap.compress_highlights`.
    """
    radiance = read_only(radiance)
    out = np.zeros(radiance.shape, np.uint8)
    constants = np.float32(exposure), np.float32(SHOULDER_START), np.float32(DESATURATION)
    in_slices(_display, len(radiance), radiance, *constants, SRGB_BYTES, out)
    return out


def prepare() -> None:
    """Compile the kernel or load it compiled, before the first picture would wait seconds for it."""
    display_bytes(np.zeros((2, 3), np.float32), 1.0)


@kernel
def _display(
    begin: int,
    end: int,
    radiance: NDArray,
    exposure: np.float32,
    start: np.float32,
    desaturation: np.float32,
    table: NDArray,
    out: NDArray,
) -> None:
    one, steps = np.float32(1.0), np.float32(len(table) - 1)
    for v in range(begin, end):
        red = max(radiance[v, 0] * exposure, np.float32(0.0))
        green = max(radiance[v, 1] * exposure, np.float32(0.0))
        blue = max(radiance[v, 2] * exposure, np.float32(0.0))
        peak = max(red, green, blue)
        if peak > start:
            shown = one - (one - start) ** 2 / (peak + one - np.float32(2.0) * start)
            saturation = one / (desaturation * (peak - shown) + one)
            scale, white = shown * saturation / peak, shown * (one - saturation)
            red, green, blue = red * scale + white, green * scale + white, blue * scale + white
        out[v, 0] = table[int(min(red, one) * steps + np.float32(0.5))]
        out[v, 1] = table[int(min(green, one) * steps + np.float32(0.5))]
        out[v, 2] = table[int(min(blue, one) * steps + np.float32(0.5))]
