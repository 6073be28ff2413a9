"""Lamps in glTF files: the lights of KHR_lights_punctual, or, without any, its emissive meshes; and as such lights.

Source: Khronos, "glTF 2.0 Specification", KHR_lights_punctual, KHR_materials_emissive_strength, KHR_texture_transform.
"""

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import GltfData, entry, warn_skipped
from splat2mesh.base.gltfnodes import shown_nodes
from splat2mesh.base.inputs import quiet_numbers, reading
from splat2mesh.base.specs import vector
from splat2mesh.scene.color import luminance
from splat2mesh.scene.gltfmesh import Piece, placed_pieces
from splat2mesh.scene.gltftextures import Textures

from .asked import WHITE, AskedLamp, Brightness, in_picture_units
from .photometry import area_normals, axis_intensity, flux
from .shapes import Lamp, MeshLamp, ProfileLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp

PUNCTUAL = "KHR_lights_punctual"

PARTS = 6
"""Into which each side of a face is cut, to look it up in its texture in the middle of each of the 36 triangles."""

WIDEST_DEG = 90.0
"""Half angle of a cone in glTF."""

NARROWEST = 1.0 - float(np.finfo(np.float32).eps)
"""Factor that keeps the beam within its cone, as glTF requires."""

BEAM, FIELD = 0.5, 0.1
"""Shares of the brightest intensity at which the beam and the cone of a profile end, as makers of lamps state them."""

FLAT = 0.95
"""Of the area of a mesh, as seen from its best side, from which it shines to one side as a panel does."""


def read_gltf_lamps(path: str | os.PathLike[str]) -> list[AskedLamp]:
    """The lamps of a .glb or .gltf, in its own frame and unit: its lights, or else its meshes that glow, as one lamp.

    The intensity of a light is its candela; its range, which no light has, is not used. That of a cone falls between
    its two angles. A mesh glows as the file shows it: emission 1 is a radiance of 1 in the picture, which shows as
    white; textures count as the mean over each face. Raises InputError for a file that is broken, or has neither.
    One DataWarning counts directional lights, which are no lamps.
    """
    data = GltfData(os.fspath(path), meshless=True)
    with reading(path), quiet_numbers():
        lights = (data.document.extensions or {}).get(PUNCTUAL)
        lamps = _lights(data, (lights or {}).get("lights") or [])
        return lamps or [_glow(data)]


def read_glow(path: str | os.PathLike[str]) -> AskedLamp:
    """The meshes of a .glb or .gltf that glow, as one lamp; see `read_gltf_lamps`. Raises InputError without any."""
    data = GltfData(os.fspath(path), meshless=True)
    with reading(path), quiet_numbers():
        return _glow(data)


def _lights(data: GltfData, lights: list[Any]) -> list[AskedLamp]:
    lamps, distant = [], 0
    for _, node, matrix in sorted(shown_nodes(data), key=lambda shown: shown[0]):  # as the file lists them
        placed = (node.extensions or {}).get(PUNCTUAL)
        if placed is None:
            continue
        light = entry(lights, placed.light)
        if light.type == "directional":
            distant += 1
            continue
        color, brightness = in_picture_units(WHITE if light.color is None else light.color)
        candela = float(1.0 if light.intensity is None else light.intensity) * brightness.value
        name = str(node.name or light.name or "")
        lamps.append(AskedLamp(_shape(data, light, matrix), Brightness(candela, "candela"), color, name))
    warn_skipped(data.path, distant, "directional lights: a sun is not a lamp")
    return lamps


def _shape(data: GltfData, light: Any, matrix: NDArray) -> Lamp:
    x, y, z = matrix[:3, 3].tolist()
    # Of a ball, which glTF does not know: `khr_lights` leaves it there.
    radius = float((light.extras or {}).get("radius") or 0.0)
    if light.type == "point":
        if radius > 0.0:
            return SphereLamp((x, y, z), radius, WHITE)
        return SphereLamp((x, y, z), intensity=WHITE)
    if light.type != "spot":
        raise InputError(f"{data.path}: a light is of type {light.type}, expected point, spot or directional")
    ahead = -matrix[:3, 2]
    length = float(np.linalg.norm(ahead))
    if not length > 0.0:
        raise InputError(f"{data.path}: the node of a spot has a scale of 0, so it has no direction")
    a, b, c = (matrix[:3, 3] + ahead / length).tolist()
    cone = light.spot or {}
    outer, inner = (math.degrees(cone.get(f"{which}ConeAngle", or_else)) for which, or_else in _CONE)
    return SpotLamp((x, y, z), (a, b, c), WHITE, outer, min(inner, outer), radius)


_CONE = ("outer", math.pi / 4.0), ("inner", 0.0)


def _glow(data: GltfData) -> AskedLamp:
    glowing = {
        number
        for number, material in enumerate(data.document.materials or [])
        if any(value > 0.0 for value in material.emissiveFactor or [])
    }
    if not glowing or not data.document.meshes:
        raise InputError(f"{data.path}: holds no lamps: no point or spot light ({PUNCTUAL}) and no emissive mesh")
    vertices, faces, radiance, first = [], [], [], 0
    pieces = [piece for piece in placed_pieces(data) if piece.material in glowing]
    textures = Textures(data)
    both = [bool(data.document.materials[piece.material].doubleSided) for piece in pieces]
    for piece, two_sided in zip(pieces, both, strict=True):
        corners = piece.faces[:, ::-1] if piece.mirrored else piece.faces
        light = _emission(data, piece, corners, textures)
        bright = light.any(axis=1)
        corners, light = corners[bright] + first, light[bright]
        if two_sided and not all(both):  # beside others that are not
            corners, light = np.concatenate([corners, corners[:, ::-1]]), np.concatenate([light, light])
        vertices.append(piece.points)
        faces.append(corners)
        radiance.append(light)
        first += len(piece.points)
    textures.warn_lost()
    if not any(len(each) for each in faces):
        raise InputError(f"{data.path}: holds no lamps: its emissive materials have no faces, or black textures")
    corners, used = np.concatenate(faces), np.concatenate(vertices)
    kept, corners = np.unique(corners, return_inverse=True)
    shape = MeshLamp(used[kept], corners.reshape(-1, 3), np.concatenate(radiance), all(both))
    return AskedLamp(shape, Brightness(1.0, "picture"), name=data.path.stem)


def _emission(data: GltfData, piece: Piece, corners: NDArray, textures: Textures) -> NDArray[np.float64]:
    """Radiance of the faces of a piece, (M, 3)."""
    material = data.document.materials[piece.material]
    more = (material.extensions or {}).get("KHR_materials_emissive_strength") or {}
    factor = np.array(material.emissiveFactor, np.float64) * float(more.get("emissiveStrength", 1.0))
    texture = material.emissiveTexture and textures.on(material.emissiveTexture, piece.held)
    if texture is None:
        return np.broadcast_to(factor, (len(corners), 3))
    summed = np.zeros((len(corners), 3))
    samples = _middles()
    for weights in samples:
        summed += texture.color(np.einsum("k,mkc->mc", weights, texture.uv[corners]))
    return factor * summed / len(samples)


def _middles() -> NDArray[np.float64]:
    """Weights of a face's corners (PARTS^2, 3)."""
    a, b = (each.ravel() for each in np.mgrid[0:PARTS, 0:PARTS])
    upright, turned = a + b < PARTS, a + b < PARTS - 1
    first = np.concatenate([a[upright] + 1 / 3, a[turned] + 2 / 3]) / PARTS
    second = np.concatenate([b[upright] + 1 / 3, b[turned] + 2 / 3]) / PARTS
    return np.stack([1.0 - first - second, first, second], axis=1)


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
