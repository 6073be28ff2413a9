"""The PLY of the 3DGS reference implementation: read in any variant, written in the standard one.

Properties: x y z [nx ny nz] f_dc_0..2 [f_rest_0..] opacity (logit) scale_0..2 (log) rot_0..3 (w x y z, of any
length). f_rest is channel-major: all of red, then green, then blue. A 2DGS file has no scale_2.
Source: Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering" (2023), code release.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InputError
from ...base.outputs import staged_file
from ..splats import DEGREE_OF_COEFFICIENTS, Splats
from .encoding import logit, sigmoid
from .ply import Ply, blocks

# A 2DGS surfel has no thickness. This share of its shorter axis looks flat and keeps its covariance well
# inside float32: the variances differ by a factor of 1e-4, the rounding is 6e-8.
SURFEL_THICKNESS = 0.01
_REQUIRED = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1"]
_REQUIRED += ["rot_0", "rot_1", "rot_2", "rot_3"]
# Rows moved at a time: few enough to stay in the cache while all of their columns are picked.
_BLOCK = 8192


def read(ply: Ply, part: slice | None = None) -> Splats:
    """Read the splats of an opened PLY.

    Parameters
    ----------
    ply : Ply
    part : slice or None
        Of its rows; None takes all.

    Returns
    -------
    Splats

    Raises
    ------
    InputError
        When it is a mesh, a point cloud, empty or cut short.
    """
    names = ply.elements["vertex"].properties if "vertex" in ply.elements else {}
    missing = [name for name in _REQUIRED if name not in names]
    if missing:
        raise InputError(_explain(ply, names, missing))
    k = coefficients(ply.path, names)
    rows = ply.rows("vertex")
    rows = rows if part is None else np.array(rows[part])
    n = len(rows)
    if n == 0:
        raise InputError(f"{ply.path} holds no splats: its vertex element has 0 rows")
    means, scale_log = np.zeros((n, 3), np.float32), np.zeros((n, 3), np.float32)
    quats, opacity_logit = np.zeros((n, 4), np.float32), np.zeros(n, np.float32)
    sh = np.zeros((n, k, 3), np.float32)
    columns = {f"rot_{i}": quats[:, i] for i in range(4)} | {"opacity": opacity_logit} | rest_columns(sh)
    for i in range(3):
        columns |= {"xyz"[i]: means[:, i], f"scale_{i}": scale_log[:, i], f"f_dc_{i}": sh[:, 0, i]}
    gather(rows, {name: column for name, column in columns.items() if name in names})
    scales = np.exp(scale_log, out=scale_log)
    if "scale_2" not in names:
        scales[:, 2] = SURFEL_THICKNESS * scales[:, :2].min(axis=1)
    return Splats(means, scales, quats, sigmoid(opacity_logit), sh)


def write_inria_ply(path: str | os.PathLike[str], splats: Splats, normals: NDArray[Any] | None = None) -> None:
    """Write an INRIA PLY (little-endian float32); the file appears under its name only once it is complete.

    Parameters
    ----------
    path : path
    splats : Splats
        Opacities of exactly 0 and 1 are written as the nearest finite logits; a splat of degree 0 gets no f_rest.
    normals : ndarray, (N, 3), or None
        For `nx ny nz`, which mean nothing to most programs; zeros without.
    """
    with staged_file(path) as staging, open(staging, "wb") as file:
        for block in _blocks(splats, normals):
            file.write(block)


def inria_ply_bytes(splats: Splats) -> bytes:
    """Return the file that `write_inria_ply` writes.

    Parameters
    ----------
    splats : Splats

    Returns
    -------
    bytes
    """
    return b"".join(_blocks(splats))


def _blocks(splats: Splats, normals: NDArray[Any] | None = None) -> Iterator[bytes]:
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(3 * (splats.sh.shape[1] - 1))]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(splats)}"]
    header += [f"property float {name}" for name in names] + ["end_header\n"]
    yield "\n".join(header).encode()
    for start in range(0, len(splats), _BLOCK):
        rows = slice(start, start + _BLOCK)
        yield _packed(splats.take(rows), None if normals is None else normals[rows]).tobytes()


def coefficients(path: str | os.PathLike[str], names: Iterable[str]) -> int:
    """Count the coefficients per channel that the f_rest_* of a file make up.

    Parameters
    ----------
    path : path
        Of the file, for the message.
    names : iterable of str
        Of its properties.

    Returns
    -------
    int
        K: 1, 4, 9 or 16.

    Raises
    ------
    InputError
        Where no degree fits.
    """
    rest = {name for name in names if name.startswith("f_rest_")}
    k = 1 + len(rest) // 3
    if k not in DEGREE_OF_COEFFICIENTS or rest != {f"f_rest_{i}" for i in range(3 * (k - 1))}:
        raise InputError(f"{path}: expected 0, 9, 24 or 45 properties f_rest_0.. (SH degree 0 to 3), found {len(rest)}")
    return k


def rest_columns(sh: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """Find the index of each f_rest_* property.

    Parameters
    ----------
    sh : ndarray of float32, (N, K, 3)

    Returns
    -------
    dict of str to ndarray, (N,)
        Name to a view into `sh`.
    """
    rest = sh.shape[1] - 1
    return {f"f_rest_{c * rest + j}": sh[:, 1 + j, c] for c in range(3) for j in range(rest)}


def gather(rows: NDArray[Any], columns: Mapping[str, NDArray[np.float32]]) -> None:
    """Copy fields of a structured array into float32 columns, block by block.

    Parameters
    ----------
    rows : structured ndarray, (N,)
        As `Ply.rows` gives them.
    columns : dict of str to ndarray, (N,)
        Name of a field to the array to fill.
    """
    for start, block in blocks(rows, _BLOCK):
        for name, column in columns.items():
            column[start : start + len(block)] = block[name]


def _packed(splats: Splats, normals: NDArray[Any] | None) -> NDArray[np.float32]:
    n = len(splats)
    rest = splats.sh[:, 1:].swapaxes(1, 2).reshape(n, -1)
    scale_log = np.log(np.maximum(splats.scales, np.finfo(np.float32).tiny))
    columns = [splats.means, np.zeros((n, 3)) if normals is None else normals, splats.sh[:, 0], rest]
    columns += [logit(splats.opacities)[:, None], scale_log, splats.quats_wxyz]
    return np.hstack(columns).astype("<f4")


def _explain(ply: Ply, names: Mapping[str, str], missing: list[str]) -> str:
    faces = sum(ply.elements[name].count for name in ("face", "tristrips") if name in ply.elements)
    if faces:
        return f"{ply.path} is a mesh ({faces} faces), not a Gaussian splat: relight takes mesh files directly"
    kind = "a plain point cloud, not a" if {"x", "y", "z"} <= names.keys() else "no"
    return (
        f"{ply.path} is {kind} Gaussian splat: its vertices lack {', '.join(missing)}: "
        "give the point_cloud.ply that training wrote"
    )
