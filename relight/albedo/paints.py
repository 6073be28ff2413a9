"""Places of one hue that lie alike, and how well a light explains their colours: contrast within materials.

Noise in the irradiance of a place does not change which light its colours correlate with.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats
from splat2mesh.scene.color import luminance

HUE = 0.15
"""Log chroma that a material spans."""

LEVEL, BENEATH = 0.7, -0.3
"""Height of a normal from which a surface counts as level, and below which it hangs: floors and walls of one hue are
not of one paint."""

OUTLIER = 0.5
"""Deviation of log colour within a material that counts half."""


class Paints(NamedTuple):
    """N places in groups. group: (N,) numbers from 0. weight: (N,), outliers less. total: (G,) weight of each. colors:
    (N,) log luminance less the mean of its group. own: its weighted square."""

    group: NDArray[np.int64]
    weight: NDArray[np.float64]
    total: NDArray[np.float64]
    colors: NDArray[np.float64]
    own: float

    def off(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values (N,) or (N, L) less the weighted mean of their group."""
        columns = values.reshape(len(values), -1)
        sums = np.stack([np.bincount(self.group, self.weight * c, len(self.total)) for c in columns.T], axis=1)
        return np.asarray(values - (sums / self.total[:, None])[self.group].reshape(values.shape))

    def explained(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """(L,) part of the variance within materials that log lights (N, L) explain, 0 where they are opposed."""
        light = self.off(logs)
        across = np.maximum((self.weight * self.colors) @ light, 0.0)
        return np.asarray(across**2 / np.maximum(self.own * (self.weight @ light**2), 1e-12))


def paints_of(log_captured: NDArray[np.float64], normals: Floats) -> Paints:
    """The Paints of places with log colours and normals, (N, 3) each."""
    chroma = (log_captured - log_captured.mean(axis=1, keepdims=True))[:, :2]
    side = np.where(normals[:, 1] > LEVEL, 0.0, np.where(normals[:, 1] < BENEATH, 2.0, 1.0))
    group = numbered([chroma / HUE, side[:, None]])
    logs = np.log(luminance(np.exp(log_captured)))
    found = _grouped(group, np.ones(len(group)), logs)
    return _grouped(group, 1.0 / (1.0 + (found.colors / OUTLIER) ** 2), logs)


def numbered(columns: Sequence[Floats]) -> NDArray[np.int64]:
    """Numbers (N,) from 0 for rows that fall into the same cell of side 1: a list of (N, C)."""
    cells = np.floor(np.concatenate(columns, axis=1)).astype(np.int64)
    return np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)


def _grouped(group: NDArray[np.int64], weight: NDArray[np.float64], logs: NDArray[np.float64]) -> Paints:
    found = Paints(group, weight, np.asarray(np.bincount(group, weight), np.float64), logs, 0.0)
    colors = found.off(logs)
    return found._replace(colors=colors, own=float(weight @ colors**2))
