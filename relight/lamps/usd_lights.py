"""Lamps in USD files: the lights of UsdLux that have a position.

Source: OpenUSD, usdLux: LightAPI, ShapingAPI, and the lights of each shape.
"""

import math
import os
from collections import Counter
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import warn_skipped
from splat2mesh.base.inputs import file_size, quiet_numbers, reading
from splat2mesh.base.usd_trial import check_opens

from .asked import AskedLamp, in_picture_units
from .color import COLDEST_K, HOTTEST_K, WHITE, blackbody
from .photometry import flux
from .shapes import Lamp, MeshLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp, checked_light

USD_SUFFIXES = ".usd", ".usda", ".usdc", ".usdz"

MOST_PRIMS = 1_000_000
"""Which take half a minute to visit."""

POINT_RADIUS = 1e-3
"""Radius of the sphere for a point light: with `normalize`, any radius gives the same light."""

DISC_SIDES = 32
"""Corners of the polygon for a disc, which has the disc's area."""

MODULES = "Gf", "Sdf", "Tf", "Usd", "UsdGeom", "UsdLux", "UsdShade", "UsdVol", "Vt"
"""Of usd-core."""

_POINTLESS = "DistantLight", "DomeLight", "DomeLight_1", "PortalLight"


def read_usd_lamps(path: str | os.PathLike[str]) -> list[AskedLamp]:
    """The lamps of a .usd, .usda, .usdc or .usdz at the file's default time, in the frame and unit of the stage.

    Spheres, rectangles, discs (as polygons), cylinders, meshes with MeshLightAPI; spheres and discs with a cone are
    spots, whose softness is the share of the cone outside the beam. Their radiance, intensity x 2^exposure x colour, or
    that over the area with `normalize`, is taken as in units of the picture: 1 shows as white, as OpenUSD defines it.
    Raises InputError without usd-core, for a broken file and for one without lamps. DataWarnings count suns and domes,
    other lights, and textures, profiles, focus and other cones, without which lamps are read.
    """
    pxr = library()
    size = file_size(path, "USD file")
    with reading(path), quiet_numbers():
        if not size:
            raise InputError(f"{path}: is empty")
        check_opens(path, size)
        try:
            stage = pxr.Usd.Stage.Open(str(path))
        except pxr.Tf.ErrorException as error:
            reason = " ".join(str(error).split())[:160]
            raise InputError(f"{path}: is damaged, or not a USD file ({reason})") from None
        return _lamps(pxr, stage, str(path))


def library() -> Any:
    """The package of usd-core, with its MODULES. Raises InputError where it lacks."""
    try:
        pxr = import_module("pxr")
        for name in MODULES:
            import_module(f"pxr.{name}")
    except ImportError:
        raise InputError('USD needs usd-core: pip install "splat2mesh[usd]"') from None
    return pxr


def _lamps(pxr: Any, stage: Any, path: str) -> list[AskedLamp]:
    lamps, left, cache = [], Counter[str](), pxr.UsdGeom.XformCache()
    for count, prim in enumerate(stage.Traverse(pxr.Usd.TraverseInstanceProxies())):
        if count >= MOST_PRIMS:
            raise InputError(f"{path}: has over {MOST_PRIMS:,} prims; export its lights alone")
        if not prim.HasAPI(pxr.UsdLux.LightAPI) and not prim.IsA(pxr.UsdLux.GeometryLight):
            continue
        if pxr.UsdGeom.Imageable(prim).ComputeVisibility() == pxr.UsdGeom.Tokens.invisible:
            continue
        kind = str(prim.GetTypeName())
        if kind not in SHAPES:
            left["distant and dome lights: a sun or a sky is not a lamp" if kind in _POINTLESS else "other lights"] += 1
            continue
        matrix = np.array(cache.GetLocalToWorldTransform(prim)).T  # USD multiplies rows
        light = _radiance(pxr, prim)
        shape = SHAPES[kind](pxr, prim, matrix)
        if pxr.UsdLux.LightAPI(prim).GetNormalizeAttr().Get():
            area = float(flux(shape)[0]) / math.pi / (2.0 if getattr(shape, "two_sided", False) else 1.0)
            light = light / area if area > 0.0 else light * math.inf
        shape = _shaped(pxr, prim, matrix, shape, left)
        if getattr(shape, "intensity", None) is not None:
            light = light * math.pi * _radius(prim, matrix) ** 2
        red, green, blue = checked_light(f"{prim.GetPath()}", light.tolist())
        color, brightness = in_picture_units((red, green, blue))
        lamps.append(AskedLamp(shape, brightness, color, str(prim.GetDisplayName() or prim.GetName())))
    for what, number in left.items():
        warn_skipped(path, number, what)
    if not lamps:
        raise InputError(f"{path}: holds no lamps; expected sphere, disk, rectangle, cylinder or mesh lights of UsdLux")
    return lamps


def _radiance(pxr: Any, prim: Any) -> NDArray[np.float64]:
    light = pxr.UsdLux.LightAPI(prim)
    color = np.array(light.GetColorAttr().Get(), np.float64)
    if light.GetEnableColorTemperatureAttr().Get():
        kelvin = float(light.GetColorTemperatureAttr().Get())
        color = color * blackbody(min(max(kelvin, COLDEST_K), HOTTEST_K))
    stops = np.float64(light.GetExposureAttr().Get())
    return np.maximum(color, 0.0) * float(light.GetIntensityAttr().Get()) * np.exp2(stops)


def _sphere(pxr: Any, prim: Any, matrix: NDArray) -> Lamp:
    return SphereLamp(_place(matrix, (0.0, 0.0, 0.0)), _radius(prim, matrix), WHITE)


def _radius(prim: Any, matrix: NDArray) -> float:
    """In the world; under an uneven scale that of a ball of the same volume."""
    radius = float(prim.GetAttribute("inputs:radius").Get()) or POINT_RADIUS
    return radius * abs(float(np.linalg.det(matrix[:3, :3]))) ** (1.0 / 3.0)


def _is_point(prim: Any) -> bool:
    points = prim.GetTypeName() == "SphereLight" and prim.GetAttribute("treatAsPoint").Get()
    return bool(points) or prim.GetAttribute("inputs:radius").Get() == 0.0


def _rectangle(pxr: Any, prim: Any, matrix: NDArray) -> Lamp:
    width, height = (float(prim.GetAttribute(f"inputs:{name}").Get()) for name in ("width", "height"))
    u, v = matrix[:3, 1] * height, matrix[:3, 0] * width  # y x x = -z, where it shines
    if np.cross(u, v) @ matrix[:3, 2] > 0.0:
        u, v = v, u
    return RectangleLamp(_place(matrix, (0.0, 0.0, 0.0)), tuple(u.tolist()), tuple(v.tolist()), WHITE)


def _disc(pxr: Any, prim: Any, matrix: NDArray) -> Lamp:
    turn = 2.0 * np.pi * np.arange(DISC_SIDES) / DISC_SIDES
    wider = math.sqrt(2.0 * math.pi / (DISC_SIDES * math.sin(2.0 * math.pi / DISC_SIDES)))
    radius = float(prim.GetAttribute("inputs:radius").Get()) * wider
    ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(DISC_SIDES)], axis=1)
    vertices = ring @ matrix[:3, :3].T + matrix[:3, 3]
    rest = np.arange(1, DISC_SIDES - 1)
    faces = np.stack([np.zeros_like(rest), rest + 1, rest], axis=1)  # clockwise from +z: it shines along -z
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    return MeshLamp(vertices, faces, np.array(WHITE))


def _tube(pxr: Any, prim: Any, matrix: NDArray) -> Lamp:
    length, radius = (float(prim.GetAttribute(f"inputs:{name}").Get()) for name in ("length", "radius"))
    across = float(np.linalg.norm(np.cross(matrix[:3, 1], matrix[:3, 2]))) ** 0.5
    start, end = (_place(matrix, (side * length / 2.0, 0.0, 0.0)) for side in (-1.0, 1.0))
    return TubeLamp(start, end, radius * across, WHITE)


def _mesh(pxr: Any, prim: Any, matrix: NDArray) -> Lamp:
    mesh = pxr.UsdGeom.Mesh(prim)
    points = np.array(mesh.GetPointsAttr().Get(), np.float64).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(), np.int64)
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(), np.int64)
    if not len(counts) or counts.min() < 3 or counts.sum() != len(corners):
        raise InputError(f"{prim.GetPath()}: its faces do not fit its corners; export it again")
    starts = np.cumsum(counts) - counts
    fan = np.repeat(starts, counts - 2)
    step = np.arange(len(fan)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    faces = np.stack([corners[fan], corners[fan + step + 1], corners[fan + step + 2]], axis=1)
    left_handed = mesh.GetOrientationAttr().Get() == pxr.UsdGeom.Tokens.leftHanded
    if left_handed != bool(np.linalg.det(matrix[:3, :3]) < 0.0):
        faces = faces[:, ::-1]
    vertices = points @ matrix[:3, :3].T + matrix[:3, 3]
    return MeshLamp(vertices, faces, np.array(WHITE), bool(mesh.GetDoubleSidedAttr().Get()))


SHAPES: dict[str, Callable[[Any, Any, NDArray], Lamp]] = {
    "SphereLight": _sphere,
    "RectLight": _rectangle,
    "DiskLight": _disc,
    "CylinderLight": _tube,
    "Mesh": _mesh,
}
"""Type of a prim -> its shape in the world, of radiance 1."""


def _shaped(pxr: Any, prim: Any, matrix: NDArray, shape: Lamp, left: Counter[str]) -> Lamp:
    """The shape with its cone: a spot, or a point where a sphere counts as one. What is left out is counted."""
    kind = str(prim.GetTypeName())
    texture = prim.GetAttribute("inputs:texture:file")
    if kind == "RectLight" and texture and texture.Get():
        left["textures of lights, which count as white"] += 1
    if isinstance(shape, SphereLamp) and _is_point(prim):
        shape = SphereLamp(shape.position, intensity=WHITE)
    if not prim.HasAPI(pxr.UsdLux.ShapingAPI):
        return shape
    shaping = pxr.UsdLux.ShapingAPI(prim)
    file = shaping.GetShapingIesFileAttr().Get()
    if file and file.path:
        left["IES profiles of lights; give the .ies file with its place"] += 1
    if (shaping.GetShapingFocusAttr().Get() or 0.0) > 0.0:
        left["focuses of lights"] += 1
    cone = shaping.GetShapingConeAngleAttr().Get()
    angle = 90.0 if cone is None else float(cone)
    if angle >= (180.0 if kind == "SphereLight" else 90.0):
        return shape
    if kind not in ("SphereLight", "DiskLight"):
        left["cones of rectangles, cylinders and meshes"] += 1
        return shape
    ahead = -matrix[:3, 2] / max(float(np.linalg.norm(matrix[:3, 2])), 1e-300)
    softness = min(max(float(shaping.GetShapingConeSoftnessAttr().Get() or 0.0), 0.0), 1.0)
    place = _place(matrix, (0.0, 0.0, 0.0))
    x, y, z = (np.array(place) + ahead).tolist()
    radius = 0.0 if _is_point(prim) else _radius(prim, matrix)
    return SpotLamp(place, (x, y, z), WHITE, angle, angle * (1.0 - softness), radius)


def _place(matrix: NDArray, local: Triple) -> Triple:
    x, y, z = (matrix[:3, :3] @ local + matrix[:3, 3]).tolist()
    return x, y, z
