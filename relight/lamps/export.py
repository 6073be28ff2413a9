"""Lamps for engines: lights of glTF, to light their objects like the splat.

They are in units of the picture: where radiance 1 shows as white, so does a white surface in a light of irradiance pi.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.specs import vector
from splat2mesh.scene.color import luminance

from .asked import WHITE
from .gltf_lights import PUNCTUAL
from .photometry import area_normals, axis_intensity, flux
from .shapes import Lamp, MeshLamp, ProfileLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp

WIDEST_DEG = 90.0
"""Half angle of a cone in glTF."""

NARROWEST = 1.0 - float(np.finfo(np.float32).eps)
"""Factor that keeps the beam within its cone, as glTF requires."""

BEAM, FIELD = 0.5, 0.1
"""Shares of the brightest intensity at which the beam and the cone of a profile end, as makers of lamps state them."""

FLAT = 0.95
"""Of the area of a mesh, as seen from its best side, from which it shines to one side as a panel does."""


def khr_lights(
    lamps: Sequence[Lamp], names: Sequence[str] | None = None
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Lamps as KHR_lights_punctual.

    lamps: in the frame and the unit of length of the glTF. names: of each. Returns what stands in `extensions` of the
    document under that name, and the nodes that show it, as JSON: translation, rotation (x y z w), extensions.

    Candela are intensities in units of the picture. Spheres are points, which keep their radius in `extras`; spots are
    spots, with the falloff of the engine between their two angles, and at most a half space wide. glTF knows no areas:
    a flat lamp that shines to one side is a spot half a space wide with its intensity on the axis, a profile that stays
    in one half a spot of its flux, anything else a point of its flux.
    """
    lights, nodes = [], []
    for number, lamp in enumerate(lamps):
        plain = _punctual(lamp)
        name = names[number] if names is not None and names[number] else f"Lamp {number + 1}"
        color, strength = _hue(plain.intensity if isinstance(plain, SpotLamp) else axis_intensity(plain))
        light: dict[str, Any] = {"name": name, "color": color, "intensity": strength, "type": "point"}
        node: dict[str, Any] = {"name": name, "translation": list(plain.position)}
        if isinstance(plain, SpotLamp):
            outer = math.radians(min(plain.cutoff_deg, WIDEST_DEG))
            inner = min(math.radians(plain.beam_deg or 0.0), outer * NARROWEST)
            light |= {"type": "spot", "spot": {"innerConeAngle": inner, "outerConeAngle": outer}}
            node["rotation"] = _rotation(_ahead(plain)).tolist()
        if plain.radius > 0.0:
            light["extras"] = {"radius": plain.radius}
        lights.append(light)
        nodes.append(node | {"extensions": {PUNCTUAL: {"light": number}}})
    return {"lights": lights}, nodes


def _punctual(lamp: Lamp) -> SphereLamp | SpotLamp:
    """A lamp as a point or a spot, as far as glTF goes."""
    match lamp:
        case SphereLamp() | SpotLamp():
            return lamp
        case RectangleLamp(two_sided=False):
            normal = np.cross(lamp.edge_u, lamp.edge_v)
            return _panel(np.array(lamp.center), normal / np.linalg.norm(normal), axis_intensity(lamp))
        case RectangleLamp():
            center = np.array(lamp.center)
        case TubeLamp():
            center = 0.5 * np.add(lamp.start, lamp.end)
        case MeshLamp():
            normals, places, weights = _faces(lamp)
            center = weights @ places / weights.sum() if weights.sum() > 0.0 else places.mean(axis=0)
            ahead, areas = normals.sum(axis=0), np.linalg.norm(normals, axis=1).sum()
            length = float(np.linalg.norm(ahead))
            if not lamp.two_sided and length > FLAT * areas:
                return _panel(center, ahead / length, axis_intensity(lamp))
        case ProfileLamp():
            spot = _spot_of(lamp)
            if spot is not None:
                return spot
            center = np.array(lamp.position)
    return SphereLamp(vector("position", center), intensity=vector("intensity", flux(lamp) / (4.0 * np.pi)))


def _panel(center: NDArray, normal: NDArray, intensity: NDArray) -> SpotLamp:
    position, target = vector("position", center), vector("target", center + normal)
    return SpotLamp(position, target, vector("intensity", intensity), WIDEST_DEG, 0.0)


def _spot_of(lamp: ProfileLamp) -> SpotLamp | None:
    """A spot of the same flux; None for a profile that shines to more than a half space."""
    around = lamp.table.mean(axis=1)
    if around.max(initial=0.0) <= 0.0:
        return None
    angles = np.linspace(0.0, 180.0, 1801)
    share = np.interp(angles, lamp.vertical_deg, around / around.max(), right=0.0)
    beam, field = (float(angles[share >= level].max()) for level in (BEAM, FIELD))
    if field > WIDEST_DEG:
        return None
    field = max(field, 0.1)
    shape = SpotLamp(lamp.position, lamp.target, WHITE, field, min(beam, field), lamp.radius)
    return replace(shape, intensity=vector("intensity", flux(lamp) / flux(shape)))


def _hue(light: Sequence[float] | NDArray) -> tuple[list[float], float]:
    """Linear RGB of which the largest is 1, and that largest; white for black."""
    values = [float(each) for each in light]
    strength = max(values)
    return ([each / strength for each in values], strength) if luminance(values) > 0.0 else (list(WHITE), 0.0)


def _ahead(lamp: SpotLamp) -> NDArray[np.float64]:
    along = np.subtract(lamp.target, lamp.position)
    return along / np.linalg.norm(along)


def _rotation(ahead: NDArray) -> NDArray[np.float64]:
    """The shortest turn, x y z w, that takes -z ahead."""
    turn = np.append(np.cross([0.0, 0.0, -1.0], ahead), 1.0 - ahead[2])
    length = float(np.linalg.norm(turn))
    return turn / length if length > 1e-7 else np.array([0.0, 1.0, 0.0, 0.0])


def _faces(lamp: MeshLamp) -> tuple[NDArray, NDArray, NDArray]:
    """Normals as long as the areas (M, 3), middles (M, 3), and luminance x area (M,) of the faces."""
    normals = area_normals(lamp)
    shine = luminance(np.broadcast_to(lamp.radiance, (len(normals), 3)))
    return normals, lamp.vertices[lamp.faces].mean(axis=1), np.linalg.norm(normals, axis=1) * shine
