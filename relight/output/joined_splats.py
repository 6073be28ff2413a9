"""Splats of objects after those of the place they are inserted into, in one file whose first rows stay unchanged."""

import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from splat2mesh.base.outputs import staged_file
from splat2mesh.splats.facts import NO_FACTS, FileFacts
from splat2mesh.splats.formats.inria import header_of, is_double, row_type, write_inria_ply
from splat2mesh.splats.formats.ply import Ply
from splat2mesh.splats.splats import Splats


def append_splats(path: str | os.PathLike[str], splats: Splats, facts: FileFacts = NO_FACTS) -> None:
    """Append splats to a file of INRIA's layout, all of whose columns are float32, or those of the places float64.

    Harmonics beyond its degree go. facts: of the splats in the file, at whose offset the others stand too.
    """
    ply = Ply.open(path)
    before, double = ply.rows("vertex"), is_double(ply)
    names = before.dtype.names or ()
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder) / "objects.ply"
        write_inria_ply(other, replace(splats, facts=facts))
        rows = np.array(Ply.open(other).rows("vertex"))
    added = np.zeros(len(rows), row_type(names, double))
    own, coefficients = rows.dtype.names or (), _coefficients(names)
    for name in names:
        source = name
        if name.startswith("f_rest_"):  # channel after channel, of another degree at another place
            channel, number = divmod(int(name[7:]), coefficients)
            theirs = _coefficients(own)
            source = f"f_rest_{channel * theirs + number}" if number < theirs else ""
        if source in own:
            added[name] = rows[source]
    kept = np.array(before).astype(row_type(names, double), copy=False).tobytes()
    header = header_of(len(before) + len(added), names, facts, double)
    del before
    with staged_file(path) as staging, open(staging, "wb") as file:
        file.write(header + kept + added.tobytes())


def _coefficients(names: tuple[str, ...]) -> int:
    """The number of coefficients of each channel beyond the constant one."""
    return max(sum(name.startswith("f_rest_") for name in names) // 3, 1)
