"""Closed rooms seen from within: how much of an environment reaches the surfaces seen there.

In a room, light comes from lamps and surfaces, and light from outside enters through windows and through the holes of
the mesh alike. Where almost none enters, the colours do not show the light of the capture, and a new environment
lights nothing that is known: its effect is assumed (`engine.assumed_light`).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Points
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.scene import Scene

from ..transfer.occluder import Frame, Occluder

LOOKS = 512
"""Directions from each place where the capture stood."""

MOST_CLOSED = 0.15
"""Mean part of the sky that reaches what is seen from where the capture stood, up to which a place is a closed room. A
trained parlour with two windows has .055, scans of an office .001 and of an exhibition room .013, a trained garden .29.
The mean over the whole mesh does not show this: the parlour's, with what its windows show outside, is .64."""


def within(scene: Scene) -> NDArray[np.float64]:
    """(E, 3) float64, scene frame: where the capture stood within; none unless it was inside a place closed in."""
    eyes = scene.capture.get("eyes", ()) if scene.capture.get("from") == "inside" else ()
    return np.asarray(eyes, np.float64).reshape(-1, 3)


def closed_part(
    scene: Scene,
    occluder: Occluder,
    visible: Floats,  # (V,) visible fraction of the vertices' cosine lobes
) -> float | None:
    """Mean visible part of the sky over the surfaces seen from inside, in [0, 1]; None unless the capture is a closed
    room.

    A closed room: the capture stood inside, and that part is at most MOST_CLOSED.
    """
    eyes = within(scene)
    if not len(eyes):
        return None
    part = sky_seen(scene, occluder, visible, eyes)
    return part if part <= MOST_CLOSED else None


BESIDE = "`placed` adds lamps, `captured` dims the captured light"
"""Advice that works in every room."""


def sky_seen(scene: Scene, occluder: Occluder, visible: Floats, eyes: Points) -> float:
    """Mean visible fraction (V,) over the surfaces seen from the eyes (E, 3), scene frame; 1 without any.

    Backs of faces, which are not meant to be seen, do not count.
    """
    seen = visible[fronts_seen(occluder, Frame.around(scene.vertices, scene.faces).unit(eyes))]
    return float(seen.mean()) if len(seen) else 1.0


def fronts_seen(occluder: Occluder, eyes: Points) -> NDArray[np.uint32]:
    """(H, 3) corners of the faces that LOOKS even looks from each of the eyes (E, 3), unit frame, meet in front."""
    directions = fibonacci_sphere(LOOKS)
    rays = np.hstack([np.repeat(eyes, LOOKS, axis=0), np.tile(directions, (len(eyes), 1))]).astype(np.float32)
    faces = occluder.first_hits(rays).faces
    hit = np.flatnonzero(faces >= 0)
    corners = occluder.faces[faces[hit]]
    return corners[np.einsum("ij,ij->i", occluder.normals[corners].sum(axis=1), rays[hit, 3:]) < 0.0]


def room_notice(part: float, found: dict[str, Any] | None, problem: str = "") -> str:
    """The line on a closed room: its sky, the lamps and windows found or the reason for none, and what to do.

    found: the report of a `rooms.Room`; None where the light of the room could not be estimated.
    """
    line = f"this is a closed room, where {100.0 * part:.1f}% of the sky reaches what was seen: "
    if found is None:
        line += f"{problem}, so all of its light is assumed to come from outside, and takes the brightness and colour "
        line += f"of a new one ({BESIDE}; "
        return f"{line}`albedo` captured lights it as it is)"
    lamps, windows = sum(any(each["radiance"]) for each in found["lamps"]), bool(found["windows"])
    line += f"{lamps or 'no'} lamp{'s' * (lamps != 1)} "
    if not windows:
        line += (
            "and no window found, so half of its light is assumed to come from outside, and takes the brightness and "
        )
        line += "colour of a new one"
    else:
        line += "found, windows let the new light in"
    if lamps and windows:
        line += f"; that they are as bright as a median albedo of {found['assumed_albedo']:g} makes them is assumed"
    tips = ["`lamps` off or a factor dims them"] * bool(lamps) + [BESIDE] * (not windows)
    return f"{line} ({', '.join(tips)})" if tips else line
