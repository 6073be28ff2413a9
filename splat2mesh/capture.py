"""What a splat shows of its capture before it is meshed: up, cameras, background, and where it was taken from."""

import os
from dataclasses import dataclass

import numpy as np

from .base.arrays import Integers, Mask, Matrix4, Vector
from .base.progress import Stages
from .options import ConvertOptions
from .render.view import View
from .splats.cleaning import clean, usable
from .splats.extent import check_extent
from .splats.foreground import far_background, foreground_ball
from .splats.formats import read_splats
from .splats.splats import Splats
from .views.located import located_views
from .views.panes import sky_in_panes
from .views.standpoints import Standpoints, standpoints
from .views.upright import upright
from .views.viewpoints import bounds_of


@dataclass(frozen=True, eq=False)
class Capture:
    """A trained splat and its capture, in the splat's own frame.

    loaded: every row of the file. splats: the N usable ones, in spatial order. rows: (N,) int, of `loaded`. dropped:
    rows left out, by reason. trained: the cameras of the training, none where they are not known. rotation: (4, 4),
    scene_from_splat. up_from: what showed the up axis. foreground: without the far background. center, radius: (3,)
    float, float, the ball beyond which that lies. far, panes: (N,) bool, the far background, and the sky in a room's
    windows, which belongs to it.
    """

    loaded: Splats
    splats: Splats
    rows: Integers
    dropped: dict[str, int]
    trained: list[View]
    rotation: Matrix4
    up_from: str
    foreground: Splats
    center: Vector
    radius: float
    far: Mask
    panes: Mask
    standing: Standpoints

    @property
    def counts(self) -> dict[str, int]:
        """Rows of the file, those dropped by reason, and those that are far background."""
        return {
            "splats": len(self.loaded),
            **{f"splats_{reason}": count for reason, count in self.dropped.items()},
            "splats_background": int(self.far.sum()),
        }


def capture_of(path: str | os.PathLike[str], asked: ConvertOptions, stages: Stages) -> Capture:
    """Read a splat and find out how it was captured. path: splat file, folder of tiles, or streamed SOG. Raises
    InputError for input that cannot be used."""
    with stages.stage("read"):
        loaded = read_splats(path, asked.lod)
        splats, dropped = clean(loaded)
        check_extent(splats)
        rows = np.flatnonzero(usable(loaded)[0])
        trained = located_views(asked.cameras, path, asked.lod, splats)
        rotation, up_from = upright(asked.up, trained, splats, lambda: is_place(splats))
    order = splats.spatial_order()
    splats, rows = splats.take(order), rows[order]
    center, radius, far = foreground_ball(splats)
    foreground = splats.take(np.flatnonzero(~far))
    with stages.stage("standpoints"):
        standing = standing_of(foreground, splats, asked, rotation[1, :3])
        panes = np.zeros(len(splats), bool)
        if standing.kind == "inside":
            panes = sky_in_panes(splats, far, bounds_of(foreground), standing.eyes)
    return Capture(
        loaded,
        splats,
        rows,
        dropped,
        trained,
        rotation,
        up_from,
        foreground,
        center,
        radius,
        far | panes,
        panes,
        standing,
    )


def standing_of(foreground: Splats, splats: Splats, asked: ConvertOptions, up: Vector) -> Standpoints:
    """The Standpoints of a capture; the sugar way knows objects only."""
    if asked.surface != "field":
        return standpoints(splats, bounds_of(foreground), "outside")
    eyes = [tuple(np.subtract(eye, splats.facts.offset).tolist()) for eye in asked.eyes]
    return standpoints(splats, bounds_of(foreground), asked.stand, eyes, asked.seed, up)


def is_place(splats: Splats) -> bool:
    """Whether a capture looked from within, whatever is up."""
    foreground = splats.take(np.flatnonzero(~far_background(splats)))
    return len(foreground) > 0 and bool(standpoints(foreground, bounds_of(foreground)).eyes)
