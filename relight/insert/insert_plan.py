"""The share of a scene that objects change and its cost, measured on a few of its vertices."""

import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask

from ..light.environment import Environment
from ..transfer.occluder import Occluder
from .gathering import OBJECT_RAYS, Casting, change_at, in_reach
from .inserts import LEAST_CHANGE, RAYS, SOFTNESS
from .standing import Standing
from .surroundings import Receiving, Sky, Surroundings, surroundings_of

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene
    from splat2mesh.splats.splats import Splats

SAMPLE = 2048
"""Vertices in reach that are traced. The standard error of a share is at most 1% of the vertices in reach."""


class InsertPlan(NamedTuple):
    """The work for inserted objects.

    objects: their number. reach: share of the scene's vertices from which an object is large enough to change their
    light. changed: share of them that change visibly under an even light, without shadows of suns and lamps.
    splats: share of the splats in reach, None where there are none. rays: for the light on the objects and the change
    of the vertices. seconds: for both.
    """

    objects: int
    reach: float
    changed: float
    splats: float | None
    rays: int
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """JSON-clean, for the report."""
        shares = {name: getattr(self, name) for name in ("reach", "changed", "splats")}
        rounded = {name: None if share is None else round(share, 5) for name, share in shares.items()}
        return {"objects": self.objects, **rounded, "rays": self.rays, "predicted_seconds": round(self.seconds, 3)}

    def table(self) -> list[str]:
        """Lines of text, below those of a plan."""
        objects = f"{self.objects} object{'s' * (self.objects > 1)}"
        splats = "" if self.splats is None else f" and {self.splats:.1%} of the splats"
        return [
            f"objects: {objects}; {self.reach:.1%} of the vertices{splats} in reach, {self.changed:.1%} change visibly",
            f"  predicted: {self.rays:,} rays, {self.seconds:.2f} s, without suns, lamps and finer shadows on splats",
        ]


def plan_inserts(standing: Standing, scene: "Scene", around: Surroundings, splats: "Splats | None") -> InsertPlan:
    """Return the InsertPlan of objects in a scene. around: of `evenly_lit`."""
    at = Receiving(around.occluder.origins, around.occluder.normals)
    reached = _reached(standing, at)
    rows = np.flatnonzero(reached)
    sample = rows[np.linspace(0, len(rows) - 1, min(SAMPLE, len(rows))).astype(np.int64)] if len(rows) else rows
    sent = standing.albedo + standing.emission
    change_at(around, standing, sent, Casting(RAYS), at.of(sample[:1]))  # compiles
    start = time.perf_counter()
    change = change_at(around, standing, sent, Casting(RAYS), at.of(sample))
    seconds = time.perf_counter() - start
    # In an even light of 1 each vertex receives at most 1. A vertex that receives less changes more, not less.
    seen = (np.abs(change) > LEAST_CHANGE * (1.0 + SOFTNESS)).any(axis=1).mean() if len(sample) else 0.0
    part = len(rows) / max(len(scene.vertices), 1)
    of_objects = OBJECT_RAYS * len(standing.vertices)
    of_scene = RAYS * len(rows)
    whole = seconds * (of_scene + of_objects) / max(RAYS * len(sample), 1)
    share = None if splats is None else float(_near(standing, scene, splats).mean())
    return InsertPlan(len(standing.objects), part, float(seen) * part, share, of_scene + of_objects, whole)


def evenly_lit(scene: "Scene", occluder: Occluder) -> Surroundings:
    """The Surroundings of a scene in its captured colours under an even sky of radiance 1."""
    even = Environment(np.ones((2, 4, 3), np.float32), "even")
    return surroundings_of(scene, occluder, scene.colors_linear, [Sky(even, 1.0)], [])


def _reached(standing: Standing, at: Receiving) -> Mask:
    found = np.zeros(len(at.origins), bool)
    for middle, radius in standing.spheres:
        found |= in_reach(middle, radius, at)
    return found


def _near(standing: Standing, scene: "Scene", splats: "Splats") -> NDArray[np.bool_]:
    """Mask of the splats in reach, regardless of orientation."""
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    points = standing.frame.unit(splats.means.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3])
    found = np.zeros(len(points), bool)
    for middle, radius in standing.spheres:
        toward = middle - points
        facing = (toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12)).astype(np.float32)
        found |= in_reach(middle, radius, Receiving(points, facing))
    return found
