"""The PLY of the 3DGS reference implementation: read in any variant, written in the standard one.

Properties: x y z [nx ny nz] f_dc_0..2 [f_rest_0..] opacity (logit) scale_0..2 (log) rot_0..3 (w x y z, of any
length). f_rest is channel-major: all of red, then green, then blue. A 2DGS file has no scale_2. Colours may stand as
red green blue instead of f_dc_0..2, and filter_3D is what Mip-Splatting adds to the extent of each splat.
Source: Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering" (2023), code release; Yu et al.,
"Mip-Splatting" (2024), equation 9 and code release.
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InputError
from ...base.outputs import staged_file
from ...base.threads import ROWS_AT_ONCE
from ..facts import HERE, NO_FACTS, FileFacts, Vector3, comments_of, facts_of_comments
from ..splats import DEGREE_OF_COEFFICIENTS, Splats
from .encoding import logit, sh_from_color, sigmoid, warn_beyond
from .ply import Ply, blocks

# A 2DGS surfel has no thickness. This share of its shorter axis looks flat and keeps its covariance well
# inside float32: the variances differ by a factor of 1e-4, the rounding is 6e-8.
SURFEL_THICKNESS = 0.01
_CENTER, _DC = ("x", "y", "z"), ("f_dc_0", "f_dc_1", "f_dc_2")
_REQUIRED = [*_CENTER, *_DC, "opacity", "scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3"]
_COLORS = ("red", "green", "blue"), ("r", "g", "b")
_FILTER = "filter_3D"
FULL_DETAIL = 1 / 7
"""Steps between float32 numbers, in splats' widths, up to which a mesh is as good as at the origin: `extent.py`."""
DEGREES = {(degree + 1) ** 2: degree for degree in range(5)}
"""Degrees of harmonics in files, by coefficients per channel; above the third they are not read."""
# Rows moved at a time: few enough to stay in the cache while all of their columns are picked.


def read(ply: Ply, part: slice | None = None, offset: Vector3 | None = None) -> Splats:
    """Read the splats of an opened PLY.

    part: of its rows; None takes all. offset: (x, y, z) or None, taken off the means; None is that of `offset_of`.
    Raises InputError when it is a mesh, a point cloud, empty or cut short. Warns with a DataWarning about harmonics
    beyond the third degree.
    """
    names, colors = _properties(ply)
    k, in_file = coefficients(ply.path, names)
    rows = ply.rows("vertex")
    offset = _offset_of(ply, rows) if offset is None else offset
    rows = rows if part is None else np.array(rows[part])
    n = len(rows)
    if n == 0:
        raise InputError(f"{ply.path} holds no splats: its vertex element has 0 rows")
    if in_file > k:
        warn_beyond(ply.path, n, DEGREES[in_file])
    means, scales = np.zeros((n, 3), np.float32), np.zeros((n, 3), np.float32)
    quats, opacities = np.zeros((n, 4), np.float32), np.zeros(n, np.float32)
    sh, widened = np.zeros((n, k, 3), np.float32), np.zeros(n if _FILTER in names else 0, np.float32)
    columns = {f"rot_{i}": quats[:, i] for i in range(4)} | {"opacity": opacities, _FILTER: widened}
    columns |= rest_columns(sh, in_file)
    for i in range(3):
        columns |= {"xyz"[i]: means[:, i], f"scale_{i}": scales[:, i], (colors or _DC)[i]: sh[:, 0, i]}
    held = {name: column for name, column in columns.items() if name in names}
    gather(rows, held, dict(zip("xyz", offset, strict=True)))
    if colors:
        sh[:, 0] = sh_from_color(sh[:, 0] / _white(names[colors[0]]))
    scales, opacities = np.exp(scales, out=scales), sigmoid(opacities)
    if "scale_2" not in names:
        scales[:, 2] = SURFEL_THICKNESS * scales[:, :2].min(axis=1)
    if len(widened):
        scales, opacities = _filtered(scales, opacities, widened)
    return Splats(means, scales, quats, opacities, sh, facts=replace(facts_of_comments(ply.comments), offset=offset))


def _properties(ply: Ply) -> tuple[Mapping[str, str], Sequence[str]]:
    """The properties of the vertices, and those of the colours where they stand for f_dc; else (). Raises InputError
    where they make no splat."""
    names = ply.elements["vertex"].properties if "vertex" in ply.elements else {}
    colors = next((each for each in _COLORS if names.keys() >= set(each)), ()) if _DC[0] not in names else ()
    missing = [name for name in _REQUIRED if name not in names and not (colors and name in _DC)]
    if missing:
        raise InputError(_explain(ply, names, missing))
    return names, colors


def offset_of(ply: Ply) -> Vector3:
    """Find what has to be taken off the coordinates of a PLY before they are float32. Returns (x, y, z): whole numbers;
    0 unless the file holds doubles that float32 would coarsen."""
    return _offset_of(ply, ply.rows("vertex")) if is_double(ply) else HERE


def is_double(ply: Ply) -> bool:
    """Return whether the coordinates of a splat are float64."""
    names = ply.elements["vertex"].properties if "vertex" in ply.elements else {}
    return all(names.get(name) == "f8" for name in _CENTER) and "scale_0" in names


def _offset_of(ply: Ply, rows: NDArray[Any]) -> Vector3:
    if not is_double(ply) or not len(rows):
        return HERE
    sample = np.array(rows[:: 1 + len(rows) // ROWS_AT_ONCE])
    places = np.stack([sample[name] for name in _CENTER], axis=1)
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        return HERE
    middle = np.rint(np.median(places, axis=0))
    step = float(np.spacing(np.abs(middle).max().astype(np.float32)))
    if not step > FULL_DETAIL * float(np.exp(np.nanmedian(sample["scale_0"].astype(np.float64)))):
        return HERE
    x, y, z = middle.tolist()
    return x, y, z


def _filtered(
    scales: NDArray[np.float32], opacities: NDArray[np.float32], widened: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Scales and opacities under the 3D filter of Mip-Splatting, whose width is that of `widened`, (N,)."""
    wide = np.sqrt(scales.astype(np.float64) ** 2 + widened.astype(np.float64)[:, None] ** 2)
    share = np.prod(scales / np.where(wide > 0, wide, 1), axis=1)
    return wide.astype(np.float32), (opacities * np.minimum(share, 1)).astype(np.float32)


def _white(code: str) -> float:
    """White as a number of a type code: floats are shares."""
    return 1.0 if code.startswith("f") else float(np.iinfo(code).max)


def write_inria_ply(path: str | os.PathLike[str], splats: Splats, normals: NDArray[Any] | None = None) -> None:
    """Write an INRIA PLY (little-endian float32); the file appears under its name only once it is complete.

    splats: opacities of exactly 0 and 1 are written as the nearest finite logits; a splat of degree 0 gets no f_rest.
    normals: (N, 3), or None, for `nx ny nz`, which mean nothing to most programs; zeros without.
    """
    with staged_file(path) as staging, open(staging, "wb") as file:
        for block in _blocks(splats, normals):
            file.write(block)


def inria_ply_bytes(splats: Splats) -> bytes:
    """Return the file that `write_inria_ply` writes."""
    return b"".join(_blocks(splats))


def properties_of(coefficients: int) -> list[str]:
    """Return the names of the properties of a file, in their order. coefficients: K of its harmonics."""
    rest = [f"f_rest_{i}" for i in range(3 * (coefficients - 1))]
    names = [*_CENTER, "nx", "ny", "nz", *_DC, *rest, "opacity", "scale_0", "scale_1", "scale_2"]
    return [*names, "rot_0", "rot_1", "rot_2", "rot_3"]


def header_of(count: int, names: Iterable[str], facts: FileFacts = NO_FACTS, double: bool = False) -> bytes:
    """Return the header of a binary file whose rows are float32. count: of its rows. names: of its properties. facts:
    comments say them. double: whether x y z are float64."""
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {each}" for each in comments_of(facts))]
    lines.append(f"element vertex {count}")
    lines += [f"property {'double' if double and name in _CENTER else 'float'} {name}" for name in names]
    return "\n".join([*lines, "end_header\n"]).encode()


def row_type(names: Iterable[str], double: bool = False) -> np.dtype:
    """Return the structured type of the rows under `header_of`."""
    return np.dtype([(name, "<f8" if double and name in _CENTER else "<f4") for name in names])


def _blocks(splats: Splats, normals: NDArray[Any] | None = None) -> Iterator[bytes | memoryview]:
    names, double = properties_of(splats.sh.shape[1]), splats.facts.offset != HERE
    yield header_of(len(splats), names, splats.facts, double)
    for start in range(0, len(splats), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        packed = _packed(splats.take(rows), None if normals is None else normals[rows])
        if double:
            part = np.zeros(len(packed), row_type(names, double))
            for i, name in enumerate(names):
                part[name] = packed[:, i]
            for name, mean, away in zip(_CENTER, splats.means[rows].T, splats.facts.offset, strict=True):
                part[name] = mean.astype(np.float64) + away
            packed = part
        yield packed.data


def coefficients(path: str | os.PathLike[str], names: Iterable[str]) -> tuple[int, int]:
    """Count the coefficients per channel that the f_rest_* of a file make up.

    path: of the file, for the message. names: of its properties. Returns read: K to read: 1, 4, 9 or 16; found: of the
    file, a key of `DEGREES`. Raises InputError where no degree fits.
    """
    rest = {name for name in names if name.startswith("f_rest_")}
    k = 1 + len(rest) // 3
    if k not in DEGREES or rest != {f"f_rest_{i}" for i in range(3 * (k - 1))}:
        raise InputError(
            f"{path}: expected 0, 9, 24, 45 or 72 properties f_rest_0.. (SH degree 0 to 4), found {len(rest)}"
        )
    return min(k, max(DEGREE_OF_COEFFICIENTS)), k


def rest_columns(sh: NDArray[np.float32], found: int) -> dict[str, NDArray[np.float32]]:
    """Find the index of each f_rest_* property. sh: (N, K, 3) float32. found: coefficients per channel in the file, K
    or more. Returns dict of str to (N,): name to a view into `sh`."""
    return {f"f_rest_{c * (found - 1) + j}": sh[:, 1 + j, c] for c in range(3) for j in range(sh.shape[1] - 1)}


def gather(
    rows: NDArray[Any], columns: Mapping[str, NDArray[np.float32]], less: Mapping[str, float] | None = None
) -> None:
    """Copy fields of a structured array into float32 columns, block by block.

    rows: (N,), as `Ply.rows` gives them. columns: dict of str to (N,), name of a field to the array to fill. less: what
    is taken off a field first, in its own precision.
    """
    less = {name: value for name, value in (less or {}).items() if value}
    for start, block in blocks(rows, ROWS_AT_ONCE):
        for name, column in columns.items():
            column[start : start + len(block)] = block[name] - less[name] if name in less else block[name]


def _packed(splats: Splats, normals: NDArray[Any] | None) -> NDArray[np.float32]:
    n, rest = len(splats), splats.sh.shape[1] - 1
    packed = np.zeros((n, len(properties_of(rest + 1))), "<f4")
    packed[:, :3], packed[:, 6:9] = splats.means, splats.sh[:, 0]
    if normals is not None:
        packed[:, 3:6] = normals
    packed[:, 9:-8].reshape(n, 3, rest)[:] = splats.sh[:, 1:].swapaxes(1, 2)  # a view of these columns
    packed[:, -8], packed[:, -4:] = logit(splats.opacities), splats.quats_wxyz
    packed[:, -7:-4] = np.log(np.maximum(splats.scales, np.finfo(np.float32).tiny))
    return packed


def _explain(ply: Ply, names: Mapping[str, str], missing: list[str]) -> str:
    faces = sum(ply.elements[name].count for name in ("face", "tristrips") if name in ply.elements)
    if faces:
        return f"{ply.path} is a mesh ({faces} faces), not a Gaussian splat: relight takes mesh files directly"
    kind = "a plain point cloud, not a" if {"x", "y", "z"} <= names.keys() else "no"
    return (
        f"{ply.path} is {kind} Gaussian splat: its vertices lack {', '.join(missing)}: "
        "give the point_cloud.ply that training wrote"
    )
