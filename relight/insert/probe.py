"""The light that arrives at a position: the splats in each direction, and the known radiance where they clip; and the
positions of a grid, and which of them are in open air.

A splat shows sky, windows and lamps as white at most. So directions that miss the mesh take the estimated or given
sky, and glowing surfaces take the solved radiance.
"""

import math
import re
import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Integers, Mask, Points, Vector
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.sphere import EVENLY, fibonacci_sphere, texel_directions
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.raycaster import corner_weights
from splat2mesh.render.view import View
from splat2mesh.scene.color import CLIPPED_SRGB, linear_from_srgb
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats
from splat2mesh.views.eyes import FOV_DEG
from splat2mesh.views.standpoints import NEAR_DIAGONAL

from ..light import HEIGHT
from ..transfer.occluder import Occluder
from .surroundings import Sky

SURE = 0.85
"""Display value of the brightest channel up to which splats show a sky as it was; from CLIPPED_SRGB on they clip it."""

INSIDE = 0.5
"""Share of directions that meet back faces, above which the position is inside something."""

MOST = 4096
"""Most probes of a grid: each renders a picture."""

MIDDLE = 0.05, 0.95
"""Quantiles of the vertices that bound a grid by default: far background lies beyond."""

BACKS = 0.25
"""Share of directions that meet back faces, and more than front faces, above which a probe is in a wall or ground."""


class LightAround(NamedTuple):
    """Known light besides the splats. skies: with their suns. glow: (V, 3) float32 radiance of the scene's vertices
    that are lamps, or None. Both in the unit of the radiance."""

    skies: list[Sky]
    glow: NDArray[np.float32] | None


class ProbedScene(NamedTuple):
    """Splats of a scene in a light, where probes stand. splats: in their own frame. exposure: units of the picture per
    unit of the radiance."""

    splats: Splats
    scene: Scene
    occluder: Occluder
    light: LightAround
    exposure: float

    def picture(self, place: Vector, height: int = HEIGHT) -> NDArray[np.float32]:
        """Return the lat-long picture (height, 2 height, 3) float32 of the light at a place (3,) in the frame of the
        splats: scene frame, units of the picture."""
        directions = texel_directions(height, 2 * height).reshape(-1, 3)
        scene, occluder, light, exposure = self.scene, self.occluder, self.light, self.exposure
        matrix = np.asarray(scene.scene_from_splat, np.float64)
        at = matrix[:3, :3] @ np.asarray(place, np.float64) + matrix[:3, 3]
        rays = np.empty((len(directions), 6), np.float32)
        rays[:, :3], rays[:, 3:] = occluder.frame.unit(at[None]), directions
        hits = occluder.first_hits(rays)
        _check_free(scene, hits.faces, directions, place)
        shown, alpha = _shown(self.splats, scene, np.asarray(place, np.float64), directions, height)
        sky = np.zeros_like(shown)
        for each in light.skies:
            sky += np.float32(each.factor * exposure) * each.environment.lookup(directions)
        away = hits.faces < 0
        found = linear_from_srgb(shown).astype(np.float32)
        clipped = np.clip((shown.max(axis=1) - SURE) / (CLIPPED_SRGB - SURE), 0.0, 1.0)[:, None]
        free = found + (1.0 - alpha[:, None]) * sky
        found[away] = (free + clipped * (np.maximum(sky, free) - free))[away]
        if light.glow is not None:
            met = np.flatnonzero(~away)
            corners = occluder.faces[hits.faces[met]]
            glow = np.einsum("nk,nkc->nc", corner_weights(hits.uv[met]), light.glow[corners]) * np.float32(exposure)
            found[met] = np.maximum(found[met], glow)
        return found.reshape(height, 2 * height, 3)


def _check_free(scene: Scene, faces: Integers, directions: NDArray, place: Vector) -> None:
    """Warn of a position inside something, with a DataWarning. faces: (N,) first hit in each direction (N, 3); -1:
    none."""
    met = np.flatnonzero(faces >= 0)
    a, b, c = np.moveaxis(scene.vertices[scene.faces[faces[met]]].astype(np.float64), 1, 0)
    backs = (np.cross(b - a, c - a) * directions[met]).sum(axis=1) > 0.0
    if backs.sum() > INSIDE * len(directions):
        at = ",".join(f"{each:g}" for each in place)
        warnings.warn(
            f"the probe at {at} stands inside something, where little light arrives", DataWarning, stacklevel=4
        )


def usual_place(scene: Scene, occluder: Occluder) -> Vector:
    """The default position of a probe, in the frame of the splats: a camera position in a room, the middle of the
    cameras elsewhere, or above an object."""
    back = np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
    eyes = np.asarray(scene.capture.get("eyes", ()), np.float64).reshape(-1, 3)
    if len(eyes) and scene.capture.get("from") == "inside":
        middle = np.median(eyes, axis=0)
        found = eyes[np.argmin(np.linalg.norm(eyes - middle, axis=1))]
    else:
        found = np.median(eyes, axis=0) if len(eyes) else scene.bounds.mean(axis=0)
        if not len(eyes):
            found[1] = scene.bounds[1, 1] + 0.1 * scene.diagonal
    return back[:3, :3] @ found + back[:3, 3]


def _shown(
    splats: Splats, scene: Scene, place: NDArray[np.float64], directions: NDArray, face: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Display values (N, 3), premultiplied, in [0, 1], and alpha (N,), of splats in unit directions of the scene.

    face: side of the cube's faces in pixels."""
    matrix = np.asarray(scene.scene_from_splat, np.float64)[:3, :3]
    scale = float(np.cbrt(abs(np.linalg.det(matrix))))
    turned = directions @ (matrix / scale)  # into the frame of the splats
    shown = np.zeros((len(turned), 4), np.float32)
    axis = np.abs(turned).argmax(axis=1)
    side = np.sign(turned[np.arange(len(turned)), axis])
    for number in range(6):
        forward = np.zeros(3)
        forward[number // 2] = 1.0 - 2.0 * (number % 2)
        rows = np.flatnonzero((axis == number // 2) & (side == forward[number // 2]))
        up = np.roll(np.abs(forward), 1)
        view = View.look_at(place, place + forward, up, FOV_DEG, face, face)
        seen = rasterize(splats, view, NEAR_DIAGONAL * scene.diagonal / scale)
        x, y, z = view.camera_from_world[:3, :3] @ turned[rows].T
        column, row = view.fx * x / z + view.cx - 0.5, view.fy * y / z + view.cy - 0.5
        for channel, image in enumerate([*np.moveaxis(np.clip(seen.color, 0.0, 1.0), 2, 0), seen.alpha]):
            shown[rows, channel] = scipy.ndimage.map_coordinates(image, [row, column], order=1, mode="nearest")
    return shown[:, :3], shown[:, 3]


@dataclass(frozen=True)
class ProbeGrid:
    """Number of probes along x, y, z of the scene frame, or, where counts is None, their largest spacing."""

    counts: tuple[int, int, int] | None
    spacing: float = 0.0

    @classmethod
    def parse(cls, text: str) -> "ProbeGrid":
        """Parse 4x3x4, or a spacing in units of the scene. Raises InputError for anything else."""
        if re.fullmatch(r"\d{1,4}x\d{1,4}x\d{1,4}", text):
            x, y, z = (int(each) for each in text.split("x"))
            if 1 <= x * y * z <= MOST:
                return cls((x, y, z))
            raise InputError(f"`probes` {text}: {x * y * z:,} probes; expected 1 to {MOST:,}")
        try:
            spacing = float(text)
        except ValueError:
            spacing = math.nan
        if math.isfinite(spacing) and spacing > 0.0:
            return cls(None, spacing)
        raise InputError(f"`probes` {text}: expected counts along x, y and z, such as 4x3x4, or a spacing above 0")

    def within(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions (N, 3) in a box, from corner to corner, (3,) each; a single one along an axis is in the middle.
        x runs fastest, then y.

        Raises InputError for more than MOST."""
        size = high - low
        counts = np.array(self.counts) if self.counts else np.ceil(size / self.spacing - 1e-9) + 1
        if counts.prod() > MOST:
            found = f"`probes` {self.spacing:g}: {counts.prod():,.0f} probes"
            raise InputError(f"{found}; expected at most {MOST:,}, so a larger spacing")
        counts = counts.astype(np.int64)
        step = np.where(counts > 1, size / np.maximum(counts - 1, 1), 0.0)
        first = np.where(counts > 1, low, (low + high) / 2)
        z, y, x = np.meshgrid(*(np.arange(each) for each in counts[::-1]), indexing="ij")
        return np.asarray(first + np.stack([x, y, z], axis=-1).reshape(-1, 3) * step)


def usual_box(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner, (3,) each, of the default box of a grid, scene frame."""
    low, high = np.quantile(scene.vertices.astype(np.float64), MIDDLE, axis=0)
    return low, high


def free(scene: Scene, occluder: Occluder, positions: Points) -> Mask:
    """Mask (N,) bool of the positions (N, 3), scene frame, that are outside walls, bodies and the ground."""
    directions = fibonacci_sphere(EVENLY)
    a, b, c = np.moveaxis(scene.vertices[scene.faces].astype(np.float64), 1, 0)
    normals = np.cross(b - a, c - a)
    result = np.empty(len(positions), bool)
    rays = np.empty((EVENLY, 6), np.float32)
    rays[:, 3:] = directions
    for number, at in enumerate(np.asarray(positions, np.float64)):
        rays[:, :3] = occluder.frame.unit(at[None])
        faces = occluder.first_hits(rays).faces
        met = np.flatnonzero(faces >= 0)
        backs = int(((normals[faces[met]] * directions[met]).sum(axis=1) > 0.0).sum())
        result[number] = not (backs > BACKS * EVENLY and 2 * backs > len(met))
    return result
