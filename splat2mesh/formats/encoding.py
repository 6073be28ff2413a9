"""Encodings that several formats share: opacity logits, colours as coefficients, packed quaternions."""

import numpy as np

from ..splats import SH_C0


def sigmoid(logits):
    """Opacities in [0, 1] of logits, any shape; infinite logits give exactly 0 and 1, NaN stays NaN."""
    return 1 / (1 + np.exp(-logits))


def logit(opacities):
    """Finite float64 logits of opacities in [0, 1], any shape; 0 and 1 count as their neighbours."""
    info = np.finfo(np.float32)
    p = np.clip(np.asarray(opacities, np.float64), info.tiny, 1 - info.epsneg)
    return np.log(p) - np.log1p(-p)


def sh_from_color(color_srgb):
    """The constant coefficient whose colour is `color_srgb`: any shape in, same shape float32 out."""
    return ((color_srgb - 0.5) / SH_C0).astype(np.float32)


def restore_largest(small, largest):
    """Unit quaternions from their three smaller components ("smallest three").

    small: (N, 3) the components that are left, in their order. largest: (N,) integer 0..3, the place of the
    one left out. Returns (N, 4) float32 in the same order, the restored component positive.
    """
    quats = np.zeros((len(small), 4), np.float32)
    places = np.arange(3) + (np.arange(3) >= largest[:, None])
    np.put_along_axis(quats, places, small.astype(np.float32), axis=1)
    rest = np.sqrt(np.maximum(0, 1 - np.einsum("ij,ij->i", small, small))).astype(np.float32)
    np.put_along_axis(quats, largest[:, None].astype(np.intp), rest[:, None], axis=1)
    return quats
