"""Lamps for engines and renderers: lights of glTF and of USD, to light their objects like the splat.

Both are in units of the picture: where radiance 1 shows as white, so does a white surface in a light of irradiance pi.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Triple

from .color import WHITE, luminance
from .gltf_lights import PUNCTUAL
from .photometry import area_normals, axis_intensity, flux
from .shapes import Lamp, MeshLamp, ProfileLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp
from .usd_lights import POINT_RADIUS, library

WIDEST_DEG = 90.0
"""Half angle of a cone in glTF."""

NARROWEST = 1.0 - 1e-6
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


def define_lamps(
    stage: Any,  # pxr.Usd.Stage
    lamps: Sequence[Lamp],
    names: Sequence[str] | None = None,
    parent: str = "/World/Lamps",
) -> list[str]:
    """Add lamps to a USD stage as lights of UsdLux. Returns the paths of their prims, in the order of the lamps.

    lamps: in the frame and unit of the stage. names: shown for each. Radiance is intensity x colour. Points and
    spots of radius 0 are spheres of POINT_RADIUS that count as points; the softness of a spot is the share of its cone
    outside the beam. A rectangle that shines to both sides is two prims, the second one below the path that is
    returned; a mesh has the mean of its radiance, and a profile is a spot or a point as in glTF. Raises InputError
    without usd-core.
    """
    pxr, paths = library(), []
    if lamps:
        pxr.UsdGeom.Scope.Define(stage, parent)
    for number, lamp in enumerate(lamps):
        path = f"{parent}/Lamp_{number + 1}"
        _define(pxr, stage, path, lamp)
        if names is not None and names[number]:
            stage.GetPrimAtPath(path).SetDisplayName(names[number])
        paths.append(path)
    return paths


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
    return SphereLamp(_vector(center), intensity=_vector(flux(lamp) / (4.0 * np.pi)))


def _panel(center: NDArray, normal: NDArray, intensity: NDArray) -> SpotLamp:
    return SpotLamp(_vector(center), _vector(center + normal), _vector(intensity), WIDEST_DEG, 0.0)


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
    return SpotLamp(
        *(lamp.position, lamp.target, _vector(flux(lamp) / flux(shape)), field, min(beam, field), lamp.radius)
    )


def _define(pxr: Any, stage: Any, path: str, lamp: Lamp) -> None:
    if isinstance(lamp, ProfileLamp):
        lamp = _punctual(lamp)
    match lamp:
        case SphereLamp() | SpotLamp():
            light = pxr.UsdLux.SphereLight.Define(stage, path)
            radius = lamp.radius or POINT_RADIUS
            light.CreateRadiusAttr(radius)
            light.CreateTreatAsPointAttr(lamp.radius == 0.0)
            frame = np.eye(3)
            if isinstance(lamp, SpotLamp):
                frame = _frame(_ahead(lamp))
                shaping = pxr.UsdLux.ShapingAPI.Apply(light.GetPrim())
                shaping.CreateShapingConeAngleAttr(lamp.cutoff_deg)
                shaping.CreateShapingConeSoftnessAttr(1.0 - (lamp.beam_deg or 0.0) / lamp.cutoff_deg)
            _place(pxr, light, lamp.position, frame)
            _shine(pxr, light, axis_intensity(lamp) / (math.pi * radius**2))
        case RectangleLamp():
            _rectangle(pxr, stage, path, lamp)
            if lamp.two_sided:
                # Within the first one's frame, turned about its y axis.
                back = pxr.UsdLux.RectLight.Define(stage, f"{path}/Back")
                width, height = (float(np.linalg.norm(edge)) for edge in (lamp.edge_v, lamp.edge_u))
                back.CreateWidthAttr(width)
                back.CreateHeightAttr(height)
                back.AddRotateYOp().Set(180.0)
                _shine(pxr, back, np.array(lamp.radiance))
        case TubeLamp():
            light = pxr.UsdLux.CylinderLight.Define(stage, path)
            along = np.subtract(lamp.end, lamp.start)
            light.CreateLengthAttr(float(np.linalg.norm(along)))
            light.CreateRadiusAttr(lamp.radius)
            # x of the frame along the tube: of the one whose -z goes there, turned.
            x, y, z = _frame(along / np.linalg.norm(along)).T
            _place(pxr, light, _vector(0.5 * np.add(lamp.start, lamp.end)), np.stack([-z, y, x], axis=1))
            _shine(pxr, light, np.array(lamp.radiance))
        case MeshLamp():
            _mesh(pxr, stage, path, lamp)


def _rectangle(pxr: Any, stage: Any, path: str, lamp: RectangleLamp) -> None:
    light = pxr.UsdLux.RectLight.Define(stage, path)
    u, v = np.array(lamp.edge_u), np.array(lamp.edge_v)
    height, width = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    light.CreateWidthAttr(width)
    light.CreateHeightAttr(height)
    normal = np.cross(u, v)
    # x along v and y along u, at right angles or not; it shines along -z.
    _place(pxr, light, lamp.center, np.stack([v / width, u / height, -normal / np.linalg.norm(normal)], axis=1))
    _shine(pxr, light, np.array(lamp.radiance))


def _mesh(pxr: Any, stage: Any, path: str, lamp: MeshLamp) -> None:
    mesh, vt = pxr.UsdGeom.Mesh.Define(stage, path), pxr.Vt
    points = lamp.vertices.astype(np.float32)
    mesh.CreatePointsAttr(vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points)))
    mesh.CreateFaceVertexCountsAttr(vt.IntArray.FromNumpy(np.full(len(lamp.faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(vt.IntArray.FromNumpy(lamp.faces.ravel().astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr(pxr.UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(lamp.two_sided)
    mesh.CreateExtentAttr(vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
    light = pxr.UsdLux.MeshLightAPI.Apply(mesh.GetPrim())
    normals, _, _ = _faces(lamp)
    areas = np.linalg.norm(normals, axis=1)
    even = np.full(len(areas), 1.0 / len(areas)) if areas.sum() == 0.0 else areas / areas.sum()
    _shine(pxr, pxr.UsdLux.LightAPI(light), even @ np.broadcast_to(lamp.radiance, (len(areas), 3)))


def _shine(pxr: Any, light: Any, radiance: NDArray) -> None:
    color, strength = _hue(radiance)
    light.CreateIntensityAttr(strength)
    light.CreateColorAttr(pxr.Gf.Vec3f(*color))


def _place(pxr: Any, light: Any, position: Triple, frame: NDArray) -> None:
    """frame (3, 3): its columns are the axes of the light."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = frame, position
    light.AddTransformOp().Set(pxr.Gf.Matrix4d(matrix.T.tolist()))  # USD multiplies rows


def _hue(light: Sequence[float] | NDArray) -> tuple[list[float], float]:
    """Linear RGB of which the largest is 1, and that largest; white for black."""
    values = [float(each) for each in light]
    strength = max(values)
    return ([each / strength for each in values], strength) if luminance(values) > 0.0 else (list(WHITE), 0.0)


def _ahead(lamp: SpotLamp) -> NDArray[np.float64]:
    along = np.subtract(lamp.target, lamp.position)
    return along / np.linalg.norm(along)


def _frame(ahead: NDArray) -> NDArray[np.float64]:
    """A right-handed frame (3, 3), its axes in columns, whose -z goes ahead."""
    z = -ahead
    beside = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(beside, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _rotation(ahead: NDArray) -> NDArray[np.float64]:
    """The shortest turn, x y z w, that takes -z ahead."""
    turn = np.append(np.cross([0.0, 0.0, -1.0], ahead), 1.0 - ahead[2])
    length = float(np.linalg.norm(turn))
    return turn / length if length > 1e-7 else np.array([0.0, 1.0, 0.0, 0.0])


def _faces(lamp: MeshLamp) -> tuple[NDArray, NDArray, NDArray]:
    """Normals as long as the areas (M, 3), middles (M, 3), and luminance x area (M,) of the faces."""
    normals = area_normals(lamp)
    shine = np.broadcast_to(lamp.radiance, (len(normals), 3)) @ [0.2126, 0.7152, 0.0722]
    return normals, lamp.vertices[lamp.faces].mean(axis=1), np.linalg.norm(normals, axis=1) * shine


def _vector(values: NDArray) -> Triple:
    x, y, z = values.tolist()
    return x, y, z
