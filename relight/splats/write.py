"""relit_splat.ply: INRIA's layout, one row for each row of the source, in its order.

The header says of the splats what that of the source says; coordinates in double precision stay so.
"""

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.threads import ROWS_AT_ONCE
from splat2mesh.splats.formats.encoding import logit
from splat2mesh.splats.formats.inria import header_of, is_double, properties_of, rest_columns, row_type, write_inria_ply
from splat2mesh.splats.formats.ply import Ply
from splat2mesh.splats.splats import Splats

_KEPT = (
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "opacity",
    "scale_0",
    "scale_1",
    "scale_2",
    "rot_0",
    "rot_1",
    "rot_2",
    "rot_3",
)


HIDDEN = np.float32(logit(0.0))
"""Logit of the opacity of a splat that is left out: that of 0 in every file that is written here."""


def write_relit_ply(
    path: str | os.PathLike[str],
    splats: Splats,
    source: str | os.PathLike[str] | None = None,
    normals: NDArray[np.float32] | None = None,
) -> None:
    """Write relit Splats. Where `source`, the file they were read from, is an INRIA PLY, all but the colours is copied
    from it value by value, float32 to the bit; any other file's splats are written as they were read, and so are
    extents and opacities under the filter of Mip-Splatting. Splats of opacity 0 have the opacity HIDDEN. normals:
    (N, 3) float32 for `nx ny nz`, those of the source without.

    Raises InputError when the source holds another number of splats.
    """
    ply = None if source is None else _inria_ply(source)
    if ply is None:
        write_inria_ply(path, splats, normals)
        return
    rows = ply.rows("vertex")
    if len(rows) != len(splats):
        raise InputError(
            f"{source} holds {len(rows)} splats, {len(splats)} are to be written: give the file they are of"
        )
    names, double = properties_of(splats.sh.shape[1]), is_double(ply)
    given = {f"f_dc_{c}": splats.sh[:, 0, c] for c in range(3)} | rest_columns(splats.sh, splats.sh.shape[1])
    given |= {} if normals is None else {f"n{axis}": normals[:, i] for i, axis in enumerate("xyz")}
    if "filter_3D" in (rows.dtype.names or ()):
        given |= {f"scale_{i}": _log(splats.scales[:, i]) for i in range(3)}
        given |= {"opacity": logit(splats.opacities).astype(np.float32)}
    with staged_file(path) as staging, open(staging, "wb") as file:
        file.write(header_of(len(splats), names, splats.facts, double))
        for start in range(0, len(rows), ROWS_AT_ONCE):
            block = np.array(rows[start : start + ROWS_AT_ONCE])
            columns = block.dtype.names or ()
            packed = np.zeros(len(block), row_type(names, double))
            for name in names:
                if name in given:
                    packed[name] = given[name][start : start + ROWS_AT_ONCE]
                elif name in columns:
                    packed[name] = block[name]
            packed["opacity"][splats.opacities[start : start + ROWS_AT_ONCE] == 0.0] = HIDDEN
            if "scale_2" not in columns:  # a 2DGS file: as thick as its splats were read
                packed["scale_2"] = _log(splats.scales[start : start + ROWS_AT_ONCE, 2])
            file.write(packed.tobytes())


def _log(scales: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.log(np.maximum(scales, np.finfo(np.float32).tiny))


def _inria_ply(path: str | os.PathLike[str]) -> Ply | None:
    """The source as an INRIA PLY, or None where it is of another kind."""
    if Path(path).is_dir():
        return None
    with open(path, "rb") as file:
        if file.readline(16).strip() != b"ply":
            return None
    ply = Ply.open(path)
    names = ply.elements["vertex"].properties if "vertex" in ply.elements else {}
    return ply if set(_KEPT) - {"nx", "ny", "nz", "scale_2"} <= names.keys() else None
