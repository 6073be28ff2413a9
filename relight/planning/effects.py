"""The effects of light transport, and which of them a scene needs."""

from typing import TYPE_CHECKING, Any

from ..options import LightingOptions
from ..transfer.settings import BOUNCES, EFFECTS, SHADOWS, SUN, VOLUME

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from splat2mesh.scene.scene import Scene

    from ..light.environment import Environment
    from .plan import Plan

__all__ = ["BOUNCES", "EFFECTS", "SHADOWS", "SUN", "VOLUME", "plan"]


def plan(
    scene: "Scene",
    environment: "Environment",
    tolerance: float | None = None,
    albedo_linear: "NDArray[np.floating] | None" = None,
    angles: int = 1,
    **options: Any,
) -> "Plan":
    """The settings for a Scene under an Environment, at any rotation of it: a `planning.plan.Plan`.

    On a sample of the vertices it measures the contribution of each effect, and picks the cheapest settings whose
    predicted error (relative L2 of exit radiance) is within the tolerance. albedo_linear: (V, 3), white without.
    angles: for how many lights. options: of LightingOptions, such as budget_s. Raises InputError for a scene that
    cannot be lit.
    """
    from ..transfer.occluder import Occluder
    from ..transfer.volume import Foliage
    from .decide import PlannedScene, planned

    sizes = [len(chunk.vertices) for chunk in scene.chunks]
    occluder = Occluder(scene.vertices, scene.normals, scene.faces)
    wishes = LightingOptions(tolerance=tolerance, **options).planned()
    known = PlannedScene(occluder, sizes, albedo_linear, Foliage.of_scene(scene))
    return planned(known, environment, wishes, angles)
