"""Reader of the data set that the Neural-GASh paper published: text files with a row for each vertex, no faces.

NAME.coefficients.txt holds 27 numbers t_(3 j + k), harmonic j and colour k, with the Condon-Shortley phase; besides,
NAME_vertices.txt and NAME_normals.txt. Source: Geronikolakis et al., "Neural-GASh", arXiv:2507.13917, 2025.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from relight.sh import harmonics
from splat2mesh.base.errors import InputError

COEFFICIENTS = ".coefficients.txt"


class Published(NamedTuple):
    """name. vertices, normals: (V, 3) float32. transfer: (V, 9, 3) float32, in our basis, harmonic before colour."""

    name: str
    vertices: np.ndarray
    normals: np.ndarray
    transfer: np.ndarray


def published_meshes(folder):
    """Yield the files of a folder, in the order of names. Raises InputError without files, or for unfit ones."""
    files = sorted(Path(folder).glob("*" + COEFFICIENTS))
    if not files:
        raise InputError(f"{folder}: expected files named NAME{COEFFICIENTS}, found none")
    for file in files:
        name = file.name.removesuffix(COEFFICIENTS)
        rows = _table(file, 27)
        vertices, normals = (_table(file.with_name(f"{name}_{part}.txt"), 3) for part in ("vertices", "normals"))
        if not len(rows) == len(vertices) == len(normals):
            counts = f"{len(vertices)} vertices, {len(normals)} normals, {len(rows)} rows of coefficients"
            raise InputError(f"{file}: expected as many of each, found {counts}")
        # (-1)^m on either side: the change of sign between the two phases is the one that 3DGS files need.
        yield Published(name, vertices, normals, harmonics.from_3dgs(rows.reshape(-1, 9, 3)))


def _table(file, columns):
    """The numbers of a text file, (N, columns) float32."""
    if not file.is_file():
        raise InputError(f"{file}: expected a file of {columns} numbers a row, found none")
    try:
        rows = np.loadtxt(file, np.float32, ndmin=2)
    except ValueError as error:
        raise InputError(f"{file}: expected {columns} numbers a row: {str(error).splitlines()[0]}") from error
    if rows.shape[1] != columns or not np.isfinite(rows).all():
        found = f"{rows.shape[1]} numbers a row" if rows.shape[1] != columns else "numbers that are not finite"
        raise InputError(f"{file}: expected {columns} finite numbers a row, found {found}")
    return rows
