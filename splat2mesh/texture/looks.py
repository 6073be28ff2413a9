"""Views that show the surface of a scene that was made before, for a texture that its folder does not hold."""

import numpy as np

from ..render.view import View
from ..scene.scene import Scene
from ..splats.foreground import far_background
from ..splats.splats import Splats
from ..surface.background import views_from_within
from ..surface.extract import EFFORTS, Look, as_trained, dilated
from ..surface.place import place_look
from ..views.eyes import Eye, around
from ..views.panes import sky_in_panes
from ..views.standpoints import NEAR_DIAGONAL
from ..views.viewpoints import bounds_of, virtual_views


def looks_of(scene: Scene, splats: Splats, seed: int = 0) -> list[Look]:
    """Each Look from which `convert` would colour a Scene: around an object, or from the eyes of a place. splats: clean
    Splats of the scene, in their own frame. Cameras of the capture are not known any more."""
    splats = splats.in_spatial_order()
    effort, far = EFFORTS["normal"], far_background(splats)
    foreground, back = splats.take(np.flatnonzero(~far)), np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
    up = back[:3, 1] / np.linalg.norm(back[:3, 1])
    if scene.is_place:
        bounds = bounds_of(foreground)
        near = NEAR_DIAGONAL * float(np.linalg.norm(np.ptp(bounds, axis=0)))
        eyes = [Eye(back[:3, :3] @ np.asarray(eye, np.float64) + back[:3, 3], near) for eye in scene.capture["eyes"]]
        if scene.capture.get("from") == "inside":
            splats = splats.take(np.flatnonzero(~sky_in_panes(splats, far, bounds, eyes)))
        views, planes = around(eyes, effort.pixels, up)
        return [place_look(splats, views, planes)]
    shown, pixel = as_trained(foreground)
    looks = [Look.around(shown, pixel, virtual_views(shown, effort.views, effort.pixels, up, seed))]
    if far.any() and scene.settings.get("background") == "keep":
        behind = dilated(splats.take(np.flatnonzero(far)), pixel)
        looks.append(Look.around(behind, pixel, views_from_within(shown, effort.pixels, up)))
    return looks


def looks_from(views: list[View], splats: Splats) -> list[Look]:
    """One Look at splats, as wide as training saw them, from given views."""
    return [Look.around(*as_trained(splats), views)]
