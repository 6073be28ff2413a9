"""PLY files of splats, written out coefficient by coefficient, in any order and type."""

import numpy as np


def inria_columns(splats):
    """Name -> (N,) float32 of the INRIA layout, written out coefficient by coefficient."""
    rest = splats.sh.shape[1] - 1
    columns = dict(zip("xyz", splats.means.T, strict=True))
    columns |= {f"f_dc_{c}": splats.sh[:, 0, c] for c in range(3)}
    for c in range(3):
        columns |= {f"f_rest_{c * rest + j}": splats.sh[:, 1 + j, c] for j in range(rest)}
    columns["opacity"] = np.log(splats.opacities / (1 - splats.opacities))
    columns |= {f"scale_{i}": np.log(splats.scales[:, i]) for i in range(3)}
    return columns | {f"rot_{i}": splats.quats_wxyz[:, i] for i in range(4)}


def ply_bytes(columns, order="<", kinds=None, before="", after="", newline="\n"):
    """A PLY of one vertex element. order: "<", ">" or "ascii". kinds: property -> type if not float."""
    kinds = {name: (kinds or {}).get(name, "float") for name in columns}
    codes = {"float": "f4", "double": "f8", "int": "i4", "uchar": "u1", "short": "i2", "uint": "u4"}
    format = {"<": "binary_little_endian", ">": "binary_big_endian", "ascii": "ascii"}[order]
    n = len(next(iter(columns.values())))
    header = ["ply", f"format {format} 1.0", "comment end_header", *before.split("\n"), f"element vertex {n}"]
    header += [f"property {kinds[name]} {name}" for name in columns] + after.split("\n") + ["end_header"]
    text = newline.join(line for line in header if line) + newline
    if order == "ascii":
        rows = zip(*columns.values(), strict=True)
        return (text + "".join(" ".join(f"{v:.9g}" for v in row) + newline for row in rows)).encode()
    rows = np.zeros(n, [(name, order + codes[kinds[name]]) for name in columns])
    for name, values in columns.items():
        rows[name] = values
    return text.encode() + rows.tobytes()
