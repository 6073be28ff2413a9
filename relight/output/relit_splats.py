"""Splats relit like the mesh that they are bound to."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance
from splat2mesh.base.progress import Stages
from splat2mesh.splats.splats import Splats

from ..gloss.scene_gloss import NewLight
from ..insert.inserts import shadowed
from ..light.environment import Environment
from ..splats.binding import ROUNDS, Binding
from ..splats.light_ratio import Usual
from ..splats.sky import FarSplats

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight


class BoundSplats(NamedTuple):
    """Splats bound to their mesh, and what a light changes of them.

    binding: their Binding. before: (V, 3) captured irradiance over pi. far: what shows the sky, or None. gloss: takes
    relit splats and a NewLight, and returns the splats with its reflections; None without.
    """

    binding: Binding
    before: Radiance
    far: FarSplats | None = None
    gloss: Callable[[Splats, NewLight], Splats] | None = None


class SplatLight(NamedTuple):
    """A light on splats. received: (V, 3) irradiance over pi. exposure: display value per unit of it. mirrored: what
    glossy ones mirror, or None. inserted: what objects change, or None. sky: the light itself, turned, or None to leave
    the far ones. sky_factor: display value per unit of its radiance. usual: the typical change, where it is known."""

    received: NDArray[np.floating]
    exposure: float = 1.0
    mirrored: NewLight | None = None
    inserted: "InsertedLight | None" = None
    sky: Environment | None = None
    sky_factor: float = 1.0
    usual: Usual | None = None


def relit(splats: BoundSplats, light: SplatLight, rounds: int = ROUNDS, stages: Stages | None = None) -> Splats:
    """Return splats in a light, row by row. rounds: of the fit in views."""
    stages = stages or Stages()
    with stages.stage("relight splats"):
        found = splats.binding.relit(splats.before, light.received, light.exposure, rounds, light.usual)
    if splats.gloss is not None and light.mirrored is not None:
        found = splats.gloss(found, light.mirrored)
    if light.inserted is not None:
        found = shadowed(light.inserted, found)
    if splats.far is None or light.sky is None:
        return found
    with stages.stage("relight splats"):
        return splats.far.under(found, light.sky, light.sky_factor)
