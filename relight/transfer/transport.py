"""Light transport in the all-white scene: the basis for albedo, lamps and objects."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Transfer

from ..light.environment import Suns

if TYPE_CHECKING:
    from .bounces import Interreflection

Sunlit: TypeAlias = Callable[[Suns, Indices | None], NDArray[np.float32] | None]
"""(suns, vertices that are asked for, None for all) -> their light on the white scene, (V, 3), through leaves as the
transfer has it; None without suns."""


class Transport(NamedTuple):
    """Light on the white scene of V vertices.

    transfer: (V, K) of direct light. interreflection: of bounced light. sunlit: of suns; None to trace them again.
    """

    transfer: Transfer
    interreflection: "Interreflection"
    sunlit: Sunlit | None = None
