"""Splats in USD: prims of the type ParticleField3DGaussianSplat, as usd-core reads them.

Linear scales, opacities, quaternions, harmonics with the signs of 3DGS, particle after particle. The stage says which
of its axes points up; the resulting Splats are y down.
Source: OpenUSD 26.03 and later, usdVol ParticleField3DGaussianSplat and the schemas that it is made of.
"""

import os
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InputError
from ...base.extras import needed
from ...base.inputs import FREE, check_count, file_size
from ...base.usd_trial import check_opens
from ..facts import FileFacts
from ..joining import joined
from ..placing import placed, similarity
from ..splats import DEGREE_OF_COEFFICIENTS, Splats
from .encoding import sh_from_color, warn_beyond

SUFFIXES = ".usd", ".usda", ".usdc", ".usdz"
MARKS = b"#usda", b"PXR-USDC"

_TYPE = "ParticleField3DGaussianSplat"
_IDENTITY = np.array([1, 0, 0, 0], np.float32)
_TURNS = {"Y": np.diag([1.0, -1.0, -1.0]), "Z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])}
"""From each up axis to y down."""


def read(path: str | os.PathLike[str]) -> Splats:
    """Read the splats of a USD file at its default time. Returns Splats of all visible prims, in the unit of the stage.
    Raises InputError without usd-core, for a broken file, and for one without splats."""
    needed("pxr", "USD")
    from pxr import Tf, Usd, UsdGeom

    size = file_size(path, "USD file")
    check_opens(path, size)
    try:
        stage = Usd.Stage.Open(os.fspath(path))
    except Tf.ErrorException as error:
        reason = " ".join(str(error).split())[:160]
        raise InputError(f"{path}: is damaged, or not a USD file ({reason})") from None
    cache = UsdGeom.XformCache()
    parts: list[Splats] = []
    for count, prim in enumerate(stage.Traverse(Usd.TraverseInstanceProxies())):
        if count >= FREE:  # which take half a minute to visit
            raise InputError(f"{path}: has over {FREE:,} prims; export its splats alone")
        if prim.GetTypeName() != _TYPE or UsdGeom.Imageable(prim).ComputeVisibility() == UsdGeom.Tokens.invisible:
            continue
        matrix = np.array(cache.GetLocalToWorldTransform(prim)).T  # USD multiplies rows
        parts.append(placed(_splats(path, prim), matrix))
        check_count(path, sum(map(len, parts)), 4 * size)  # instances may repeat a prim
    if not parts:
        raise InputError(f"{path} holds no Gaussian splats: expected a visible prim of the type {_TYPE}")
    axis = str(UsdGeom.GetStageUpAxis(stage)).upper()
    metres = float(UsdGeom.GetStageMetersPerUnit(stage))
    facts = FileFacts(None, (0.0, -1.0, 0.0), f"the upAxis {axis} of the stage", metres=metres)
    turned = placed(joined(parts), similarity(rotation=_TURNS.get(axis, _TURNS["Y"])))
    return replace(turned, facts=facts)


def _splats(path: str | os.PathLike[str], prim: Any) -> Splats:
    def find(name: str, width: int, count: int | None = None) -> NDArray[np.float32] | None:
        for attribute in (prim.GetAttribute(name), prim.GetAttribute(f"{name}h")):  # the second in half precision
            found = attribute.Get() if attribute and attribute.HasAuthoredValue() else None
            if found is not None:
                values = np.array(found, np.float32).reshape(len(found), *([width] if width > 1 else []))
                if count is not None and len(values) < count:
                    raise InputError(f"{path}: {prim.GetPath()} has {len(values)} {name} for {count} splats")
                return values[:count]
        return None

    means = find("positions", 3)
    if means is None or not len(means):
        raise InputError(f"{path} holds no splats: {prim.GetPath()} has no positions")
    n = len(means)
    scales, opacities = find("scales", 3, n), find("opacities", 1, n)
    quats_xyzw = find("orientations", 4, n)  # as in memory
    quats = np.tile(_IDENTITY, (n, 1)) if quats_xyzw is None else quats_xyzw[:, [3, 0, 1, 2]]
    scales = np.ones((n, 3), np.float32) if scales is None else scales
    opacities = np.ones(n, np.float32) if opacities is None else opacities
    return Splats(means, scales, quats, np.clip(opacities, 0, 1), _harmonics(path, prim, find, n))


def _harmonics(path: str | os.PathLike[str], prim: Any, find: Any, n: int) -> NDArray[np.float32]:
    coefficients = find("radiance:sphericalHarmonicsCoefficients", 3)
    if coefficients is None:
        color = find("primvars:displayColor", 3)
        if color is None or len(color) not in (1, n):
            raise InputError(f"{path}: {prim.GetPath()} has no colours: expected radiance:sphericalHarmonics")
        return np.broadcast_to(sh_from_color(color), (n, 3))[:, None]
    degree = prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get()
    k = (int(degree or 0) + 1) ** 2
    if len(coefficients) < n * k:
        raise InputError(f"{path}: {prim.GetPath()} has {len(coefficients)} coefficients for {n} splats of {k}")
    kept = min(k, max(DEGREE_OF_COEFFICIENTS))
    if kept < k:
        warn_beyond(path, n, int(degree))
    return coefficients[: n * k].reshape(n, k, 3)[:, :kept]
