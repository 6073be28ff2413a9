"""Pictures of objects among splats: a splat for each sample of a pixel that meets an object, drawn with the others.

So splats before an object occlude it, and the edges of both are smooth.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.footprints import MAX_ALPHA
from splat2mesh.render.view import View
from splat2mesh.scene.color import srgb_from_linear
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.joining import joined
from splat2mesh.splats.splats import SH_C0, Splats

from ..light.tonemap import compress_highlights

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight

SAMPLES = 2
"""Along the side of a pixel."""

SIZE = 0.45
"""Standard deviation of such a splat, in its sample's width: they overlap without a gap."""

FIELD_DEG = 55.0
"""Widest field of view of the picture of an object with its surroundings; eyes are preferred where that just fits."""

ABOVE = 0.35
"""How far above an object people look from, over their distance: what an eye is below that counts against it."""

WORSE = 0.15
"""Share of the object and its surroundings that must show more from an eye that is e times too far or too near, and
from one where the capture did not stand."""


class PictureAsked(NamedTuple):
    """A picture to take. view: in the frame of the scene. exposure: units of the picture per unit of the radiance.
    samples: along the side of a pixel."""

    scene: Scene
    view: View
    exposure: float
    samples: int = SAMPLES


def with_objects(splats: Splats, inserted: "InsertedLight", asked: PictureAsked) -> Splats:
    """The splats with the objects as a picture shows them, in the frame of the splats."""
    put_in = inserted.splats_put_in(asked.exposure)
    parts = [splats] if put_in is None else [splats, put_in]
    return joined(parts + _drawn(inserted, asked))


def _drawn(inserted: "InsertedLight", asked: PictureAsked) -> list[Splats]:
    """Splats on the meshes among the objects that a picture shows, frame of the splats; none where it shows none."""
    scene, view, exposure, samples = asked
    standing, frame = inserted.standing, inserted.standing.frame
    points = standing.vertices.astype(np.float64)
    (left, right), (top, bottom) = ((samples * low, samples * high) for low, high in _box(view, points))
    column, row = np.meshgrid((np.arange(left, right) + 0.5) / samples, (np.arange(top, bottom) + 0.5) / samples)
    seen = np.stack([(column - view.cx) / view.fx, (row - view.cy) / view.fy, np.ones_like(column)], -1).reshape(-1, 3)
    ways = seen @ view.camera_from_world[:3, :3]
    rays = np.empty((len(ways), 6), np.float32)
    rays[:, :3], rays[:, 3:] = frame.unit(view.center[None]), ways
    hits = standing.caster.first_hits(rays)
    meshes = np.array([each.splat is None for each in standing.objects])
    met = np.flatnonzero(hits.faces >= 0)
    met = met[meshes[standing.owner[hits.faces[met]]]]
    depth = hits.distance[met].astype(np.float64) * frame.diagonal  # along the axis: the rays' third component is 1
    points = view.center + depth[:, None] * ways[met]
    if not len(met):
        return []
    weights = np.concatenate([1.0 - hits.uv[met].sum(axis=1, keepdims=True), hits.uv[met]], axis=1)
    radiance = np.einsum("nk,nkc->nc", weights, inserted.radiance[standing.faces[hits.faces[met]]])
    color = srgb_from_linear(compress_highlights(radiance * np.float32(exposure)))
    back = np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
    scale = float(np.cbrt(abs(np.linalg.det(back[:3, :3]))))
    size = SIZE * depth / (view.fx * samples) * scale
    count = len(met)
    quats = np.zeros((count, 4), np.float32)
    quats[:, 0] = 1.0
    means = (points @ back[:3, :3].T + back[:3, 3]).astype(np.float32)
    scales = np.repeat(size[:, None], 3, axis=1).astype(np.float32)
    sh = ((color - 0.5) / SH_C0)[:, None].astype(np.float32)
    return [Splats(means, scales, quats, np.full(count, MAX_ALPHA, np.float32), sh)]


def _box(view: View, points: NDArray[np.float64]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Columns and rows of pixels, from and to, outside which no triangle between points (N, 3) is seen."""
    seen = points @ view.camera_from_world[:3, :3].T + view.camera_from_world[:3, 3]
    depth = seen[:, 2]
    if depth.max() <= 0.0:
        return (0, 0), (0, 0)
    if depth.min() <= 1e-6 * depth.max():  # some lie beside or behind the eye
        return (0, view.width), (0, view.height)
    found = []
    for axis, (focal, middle, size) in enumerate(((view.fx, view.cx, view.width), (view.fy, view.cy, view.height))):
        place = focal * seen[:, axis] / depth + middle
        low, high = (int(np.clip(end, 0, size)) for end in (np.floor(place.min()) - 1, np.ceil(place.max()) + 1))
        found.append((low, high))
    return found[0], found[1]


def camera_of(inserted: "InsertedLight", scene: Scene, points: NDArray | None = None) -> dict[str, Any]:
    """A camera that shows all objects, from where the capture stood, or from slightly above: as of `Preview`.

    points: (N, 3) that it shows, those of the objects without."""
    points = (inserted.standing.vertices if points is None else points).astype(np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    center, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    stood = np.asarray(scene.capture.get("eyes", ()), np.float64).reshape(-1, 3)
    away = 2.2 * radius / np.tan(np.radians(FIELD_DEG) / 2.0)
    eyes = np.concatenate([stood, _above(stood, center, away)])
    distance = np.maximum(np.linalg.norm(eyes - center, axis=1), 1e-9)
    worth = _share_seen(inserted, eyes, _about(low, high)) - WORSE * np.abs(np.log(distance / away))
    worth -= np.maximum(ABOVE - (eyes[:, 1] - center[1]) / distance, 0.0)
    worth[len(stood) :] -= WORSE
    worth[distance < 2.0 * radius] = -np.inf
    best = int(np.argmax(worth))
    fov = float(np.clip(2.0 * np.degrees(np.arctan(2.2 * radius / distance[best])), 15.0, FIELD_DEG))
    return {"eye": eyes[best].tolist(), "target": center.tolist(), "up": [0.0, 1.0, 0.0], "fov_deg": fov}


def _above(stood: NDArray[np.float64], center: NDArray[np.float64], away: float) -> NDArray[np.float64]:
    """(E, 3): positions `away` from the center, slightly above it, on the sides of standpoints (S, 3) and beside."""
    ahead = np.arctan2(*(stood - center)[:, [2, 0]].T) if len(stood) else np.array([0.9])
    turn = (ahead[:, None] + np.radians([-60.0, 0.0, 60.0])).ravel()
    level = np.sqrt(1.0 - ABOVE**2)
    return center + away * np.stack([level * np.cos(turn), np.full(len(turn), ABOVE), level * np.sin(turn)], axis=1)


def _about(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, 3): points through a box from low to high, and around its foot, where its shadow falls."""
    inside = np.stack(np.meshgrid(*[[0.1, 0.5, 0.9]] * 3), -1).reshape(-1, 3)
    turn = np.arange(24) * 2.0 * np.pi / 12
    foot = np.stack([np.cos(turn), np.zeros(24), np.sin(turn)], axis=1) * np.repeat([1.0, 1.7], 12)[:, None]
    size = high - low
    radius = 0.5 * float(np.linalg.norm(size))
    base = 0.5 * (low + high) - [0.0, 0.5 * size[1] - 0.1 * radius, 0.0]
    return np.concatenate([low + inside * size, base + radius * foot])


def _share_seen(
    inserted: "InsertedLight", eyes: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(E,): the share of points (P, 3) that each eye (E, 3) sees in the place without the objects."""
    frame = inserted.standing.frame
    rays = np.empty((len(eyes), len(points), 6), np.float32)
    rays[..., :3] = frame.unit(eyes)[:, None]
    rays[..., 3:] = 0.98 * (points - eyes[:, None]) / frame.diagonal
    hidden = inserted.around.occluder.occluded(rays.reshape(-1, 6), 1.0)
    return 1.0 - hidden.reshape(len(eyes), len(points)).mean(axis=1)
