"""Splats of objects after those of the place they are inserted into, in one file whose first rows stay unchanged."""

import os
import tempfile
from pathlib import Path

import numpy as np

from splat2mesh.base.outputs import staged_file
from splat2mesh.splats.formats.inria import write_inria_ply
from splat2mesh.splats.formats.ply import Ply
from splat2mesh.splats.splats import Splats


def append_splats(path: str | os.PathLike[str], splats: Splats) -> None:
    """Append splats to a file of INRIA's layout, all of whose columns are float32. Harmonics beyond its degree go."""
    before = Ply.open(path).rows("vertex")
    names = before.dtype.names or ()
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder) / "objects.ply"
        write_inria_ply(other, splats)
        rows = np.array(Ply.open(other).rows("vertex"))
    added = np.zeros(len(rows), [(name, "<f4") for name in names])
    own, coefficients = rows.dtype.names or (), _coefficients(names)
    for name in names:
        source = name
        if name.startswith("f_rest_"):  # channel after channel, of another degree at another place
            channel, number = divmod(int(name[7:]), coefficients)
            theirs = _coefficients(own)
            source = f"f_rest_{channel * theirs + number}" if number < theirs else ""
        if source in own:
            added[name] = rows[source]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(before) + len(added)}"]
    header += [f"property float {name}" for name in names] + ["end_header\n"]
    kept = np.array(before).astype([(name, "<f4") for name in names], copy=False).tobytes()
    del before
    with staged_file(path) as staging, open(staging, "wb") as file:
        file.write("\n".join(header).encode() + kept + added.tobytes())


def _coefficients(names: tuple[str, ...]) -> int:
    """The number of coefficients of each channel beyond the constant one."""
    return max(sum(name.startswith("f_rest_") for name in names) // 3, 1)
