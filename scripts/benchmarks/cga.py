"""Speed of vertex motors against a plain write of the same bytes, and of rotors on harmonics against quadrature.

Medians in one process, with both tasks alternating.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.harness import medians
from relight.sh import cga, harmonics, rotors
from relight.transfer.analytic import unit_normals

QUICK = ["--vertices", "20000", "--repeats", "5"]


def arguments(parser):
    parser.add_argument("--vertices", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=301, help="of one rotation")


def run(options, report):
    count, rng = options.vertices, np.random.default_rng(0)
    points, normals = rng.normal(size=(2, count, 3)).astype(np.float32)

    def compared(table, label, work, other_label, other, repeats):
        work(), other()  # compiles, fills the caches
        mine, theirs = (each.wall for each in medians({"own": work, "other": other}, repeats).values())
        table.add(work=label, ms=1e3 * mine, beside=other_label, other_ms=1e3 * theirs, ratio=mine / theirs)

    columns = {"work": "<22", "ms": ".4f", "beside": "<20", "other_ms": ".4f", "ratio": ".3f"}
    table = report.table(f"{count:,} vertices", **columns)
    write = "plain write", lambda: np.full((count, 32), 1, np.float32)
    compared(table, "vertex_motors", lambda: cga.vertex_motors(points, normals), *write, 9)
    compared(table, "  of it unit_normals", lambda: unit_normals(normals), *write, 9)

    table = report.table("SH rotation of (K, 3) coefficients by one rotor", **columns)
    turn = Rotation.from_rotvec(rng.normal(size=3))
    rotor, matrix = rotors.from_axis_angle(turn.as_rotvec(), turn.magnitude()), turn.as_matrix()
    for bands in range(1, harmonics.MAX_BANDS + 1):
        light = rng.normal(size=(bands * bands, 3))
        quadrature = "quadrature", lambda c=light, n=bands: harmonics.rotation_matrix(matrix, n) @ c
        compared(table, f"{bands} bands", lambda c=light: rotors.rotate(c, rotor), *quadrature, options.repeats)
