"""A known motion, computed ahead: transfer in a few poses, blended linearly in between, for the time of two products.

Between two poses in which nothing moves further than a tenth of the scene's diagonal, blending is 1 to 2% off; over
half of that, half a percent (an arm over a table; hard shadows of suns do not blend and are not part of it). Poses lie
close where needed: an interval is halved until blending its ends gives the pose in its middle.
"""

import bisect
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Coefficients, Floats, Radiance, Transfer
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Advance

from .apply import BlockTransfer
from .dynamic import Changes, DynamicTransfer

POSE_TOLERANCE = 0.02

MAX_POSES = 1024


class BakedMotion:
    """Radiance of white vertices at any time of a motion that a DynamicTransfer was led through.

    times: list of the times, s, of the poses computed. errors: relative L2 error of the blended transfer in the middle
    of each interval, found on the way. nbytes: memory of all poses.
    """

    def __init__(
        self,
        transfer: DynamicTransfer,  # moved about
        changes_at: Callable[
            [float], Changes
        ],  # time in s -> chunk -> (vertices, normals), as `DynamicTransfer.update_all` takes them
        duration_s: float,
        tolerance: float = POSE_TOLERANCE,  # relative L2 error of the transfer of what moves, and of what does not
        shortest_s: float = 1 / 60,  # intervals are not halved below this
        first_s: float = 0.5,  # longest interval: a motion that comes back within one would not be seen
        advance: Advance = lambda count: None,  # called with 1 for every pose computed
    ) -> None:
        """Raises InputError for a duration or steps that are not above 0, and for more than MAX_POSES poses."""
        if not (np.isfinite(duration_s) and duration_s > 0.0 and shortest_s > 0.0 and first_s > 0.0):
            raise InputError(f"a motion and its steps must last longer than 0 s, found {duration_s} s")
        self._traced, self._changes_at, self._advance = transfer, changes_at, advance
        self._tolerance, self._shortest = tolerance, shortest_s
        parts = [body.rows for body in transfer.bodies if len(body.rows)]
        self._parts, self._poses = parts, list[BlockTransfer]()
        self.times, self.errors = list[float](), list[float]()
        count = int(np.ceil(duration_s / first_s - 1e-9)) + 1
        self._keep(0.0, before := self._computed(0.0))
        for start, end in pairwise(np.linspace(0.0, duration_s, count).tolist()):
            after = self._computed(end)
            self._fill(start, before, end, after)
            before = after

    @property
    def nbytes(self) -> int:
        return sum(pose.nbytes for pose in self._poses)

    def radiance(
        self, time_s: float, light: Coefficients, out: NDArray[np.float32] | None = None, albedo: Radiance | None = None
    ) -> NDArray[np.float32]:
        """max(transfer . light, 0) x albedo at a time, (V, 3) float32; see `BlockTransfer.apply`.

        Before the first pose it is that of the first, after the last that of the last.
        """
        after = bisect.bisect_right(self.times, time_s)
        if after == 0 or after == len(self.times):
            return self._poses[0 if after == 0 else -1].apply(light, out, albedo)
        first, last = self.times[after - 1], self.times[after]
        share = (time_s - first) / (last - first)
        out = self._poses[after - 1].apply((1.0 - share) * np.asarray(light), out, albedo)
        if share > 0.0:
            out += self._poses[after].apply(share * np.asarray(light), albedo=albedo)
        return out

    def _fill(self, start: float, before: Transfer, end: float, after: Transfer) -> None:
        """Keep the poses after `start` up to `end`, whose transfers are given."""
        if end - start <= self._shortest:
            self._keep(end, after)
            self.errors.append(float("nan"))
            return
        middle = (start + end) / 2.0
        there = self._computed(middle)
        off = (before + after) * np.float32(0.5) - there
        error = max(_ratio(off[rows], there[rows]) for rows in self._parts)
        if error <= self._tolerance:
            self._keep(end, after)
            self.errors.append(error)
            return
        self._fill(start, before, middle, there)
        self._fill(middle, there, end, after)

    def _computed(self, time_s: float) -> Transfer:
        self._traced.update_all(self._changes_at(time_s))
        self._advance(1)
        return self._traced.transfer.copy()

    def _keep(self, time_s: float, transfer: Transfer) -> None:
        if len(self.times) == MAX_POSES:
            raise InputError(f"the motion needs more than {MAX_POSES} poses by {time_s:g} s: raise the tolerance")
        self.times.append(time_s)
        self._poses.append(BlockTransfer(transfer))


def _ratio(off: Floats, whole: Floats) -> float:
    norm = float(np.linalg.norm(whole))
    return float(np.linalg.norm(off)) / norm if norm else 0.0
