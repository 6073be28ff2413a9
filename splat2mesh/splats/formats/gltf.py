"""Splats in glTF 2.0: KHR_gaussian_splatting as ratified, and its compression by SPZ.

Attributes of a primitive of points, linear scales, opacities, unit quaternions (x y z w), harmonics with the signs of
3DGS. glTF is y up; the resulting Splats are y down, as those of a PLY. The numbers of an SPZ within are those of the
primitive, as CesiumJS and other loaders have it, though the draft asks for half a turn about y.
Source: github.com/KhronosGroup/glTF, extensions/2.0/Khronos/KHR_gaussian_splatting and
KHR_gaussian_splatting_compression_spz_2.
"""

import os
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import DataWarning, InputError
from ...base.gltf import SPLATS, GltfData, Record, entry, warn_skipped
from ...base.gltfnodes import shown_nodes
from ...base.inputs import check_count
from ..facts import FileFacts
from ..joining import joined
from ..placing import placed, similarity
from ..splats import Splats
from . import spz
from .encoding import sh_from_color

MAGIC = b"glTF"
SUFFIXES = ".glb", ".gltf"

_SPZ = "spz"
"""In the names of extensions that hold an SPZ: KHR_gaussian_splatting_compression_spz_2 and its drafts."""
_LINEAR = "lin_rec709_display"
_UP = similarity(rotation=np.diag([1.0, -1.0, -1.0]))
"""From y up to y down."""


def read(path: str | os.PathLike[str]) -> Splats:
    """Read the splats of a .glb or .gltf file.

    Returns Splats of all nodes of the shown scene, placed by them. Raises InputError for a file without splats, a
    damaged one, and a node that stretches or mirrors its splats. Warns with a DataWarning about meshes, which are left
    out, and about colours that are converted.
    """
    data = GltfData(Path(path), meshless=True)
    parts, left, total = [], 0, 0
    for _, node, matrix in shown_nodes(data):
        if node.mesh is None:
            continue
        for primitive in entry(data.document.meshes, node.mesh).primitives:
            if not holds_splats(primitive):
                left += 1
                continue
            part = placed(_primitive(data, primitive), _UP @ matrix)
            total += len(part)
            check_count(path, total, 4 * data.size)  # nodes may repeat a mesh
            parts.append(part)
    if not parts:
        raise InputError(
            f"{path} holds no Gaussian splats ({SPLATS}): relight takes mesh files directly"
            if left
            else f"{path} holds no Gaussian splats: expected a primitive with {SPLATS}"
        )
    warn_skipped(data.path, left, "meshes: only splats are read")
    antialiased = parts[0].facts.antialiased
    facts = FileFacts(antialiased, (0.0, -1.0, 0.0), "glTF, whose y axis points up", metres=1.0)
    return replace(joined(parts), facts=facts)


def holds_splats(primitive: Any) -> bool:
    """Return whether a primitive is of splats."""
    names = primitive.extensions or {}
    return any(name == SPLATS or (_SPZ in name and "splat" in name) for name in names)


def _primitive(data: GltfData, primitive: Any) -> Splats:
    extension = primitive.extensions.get(SPLATS) or Record()
    inner = {**primitive.extensions, **(extension.extensions or {})}
    packed = [value for name, value in inner.items() if _SPZ in name and name != SPLATS]
    if packed:
        content = data.encoded(Record(bufferView=packed[0].bufferView))
        return placed(spz.read_bytes(data.path, content), _UP)  # from y down to what is stored
    splats = _from_attributes(data, primitive.attributes)
    return _from_linear(data.path, splats) if extension.colorSpace == _LINEAR else splats


def _from_attributes(data: GltfData, attributes: Mapping[str, Any]) -> Splats:
    def find(name: str, width: int, count: int | None = None) -> NDArray[np.float32] | None:
        index = attributes.get(name if name == "POSITION" else f"{SPLATS}:{name}")
        if index is None:
            return None
        values = data.array(index, f"{name} of the splats").astype(np.float32)
        expected = (values.shape[0] if count is None else count, *([width] if width > 1 else []))
        if values.shape != expected:
            raise InputError(f"{data.path}: {name} of the splats must have shape {expected}, found {values.shape}")
        return values

    means = find("POSITION", 3)
    if means is None:
        raise InputError(f"{data.path} is damaged: its splats have no POSITION")
    n = len(means)
    scales, quats = find("SCALE", 3, n), find("ROTATION", 4, n)
    if scales is None or quats is None:
        raise InputError(f"{data.path} is damaged: its splats lack SCALE or ROTATION")
    opacities, dc = find("OPACITY", 1, n), find("SH_DEGREE_0_COEF_0", 3, n)
    if opacities is None or dc is None:
        raise InputError(f"{data.path} is damaged: its splats lack OPACITY or SH_DEGREE_0_COEF_0")
    sh = [dc]
    for degree in range(1, 4):
        band = [find(f"SH_DEGREE_{degree}_COEF_{order}", 3, n) for order in range(2 * degree + 1)]
        if any(each is None for each in band):
            break
        sh += [each for each in band if each is not None]
    return Splats(means, scales, quats[:, [3, 0, 1, 2]], np.clip(opacities, 0, 1), np.stack(sh, axis=1))


def _from_linear(path: Path, splats: Splats) -> Splats:
    """Splats whose colours are linear, with those of the usual space: the curve at the mean colour, and its slope.
    Source of the curve: IEC 61966-2-1."""
    message = f"{path}: converted the linear colours of {len(splats)} splats to sRGB, what depends on the view roughly"
    warnings.warn(message, DataWarning, stacklevel=4)
    linear = np.clip(splats.colors_diffuse.astype(np.float64), 0, 1)
    low = linear <= 0.0031308
    base = np.maximum(linear, 0.0031308)
    color = np.where(low, 12.92 * linear, 1.055 * base ** (1 / 2.4) - 0.055)
    slope = np.where(low, 12.92, 1.055 / 2.4 * base ** (1 / 2.4 - 1))
    sh = splats.sh * slope[:, None]
    sh[:, 0] = sh_from_color(color)
    return replace(splats, sh=sh)
