"""Splats as objects: they lose their captured light and take the light of the place they are inserted into."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from splat2mesh.splats.placing import placed
from splat2mesh.splats.splats import Splats

from ..splats import Binding


@dataclass(frozen=True, eq=False)
class SplatObject:
    """N inserted Gaussians and the mesh that lights them.

    binding: of the splats to their own scene. irradiance: (V, 3) captured irradiance of their mesh. rows:
    (M,) of the inserted splats; far background is not among them. object_from_splat: (4, 4).
    """

    binding: Binding
    irradiance: NDArray[np.float32]
    rows: NDArray[np.int64]
    object_from_splat: NDArray[np.float64]

    def relit(
        self,
        light: NDArray[np.float32],  # (V, 3) irradiance over pi, in units of the picture
        splat_from_object: NDArray[np.float64],  # (4, 4), the splat of the place
    ) -> Splats:
        """Return them under the light of the place, in the frame of its splat."""
        splats = self.binding.relit(self.irradiance, light).take(self.rows)
        return placed(splats, splat_from_object @ self.object_from_splat)
