"""Other libraries on the files and computations of our own code: files that they accept and we refuse, and their cost.

The figures of docs/decisions.md. Hostile files are those of `scripts/bench attack`; a library reads each in a separate
process, which also reports which of our checks, of the file and of the finished mesh, would still be needed.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from importlib.metadata import distribution
from pathlib import Path

import numpy as np

QUICK = ["--inputs", "12", "--kinds", "mesh.obj"]

SECONDS = 10
"""After which a library is stopped: all whole files are read in a hundredth of a second."""

NO_FILES = 9
"""Attacks that begin the list of each kind: pipes, devices, folders, which the check of the file refuses."""

OUTCOMES = "both_read", "both_refuse", "ours_alone", "theirs_same", "theirs_other", "hang", "crash"
"""theirs_same: the library alone reads it, and as if it were whole. theirs_other: it reads something else of it."""

COSTLY = ("MB of zeros", "splats", "repeated_without_end")


def arguments(parser):
    """Arguments of this subject."""
    parser.add_argument("--inputs", type=int, default=70, metavar="N", help="files of each kind (default: %(default)s)")
    parser.add_argument("--kinds", nargs="+", metavar="KIND", help="only these kinds of files")


def run(options, report):
    """Hostile files first, then times and sizes."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "support"))
    kinds = _readers()
    table = report.table(
        "hostile files by what became of them",
        kind="<18",
        library="<12",
        **{name: "d" for name in ("inputs", *OUTCOMES)},
    )
    from attacks import READERS, Attack, attacks_of, whole_files

    with tempfile.TemporaryDirectory() as folder:
        whole = whole_files(Path(folder, "whole"))
        for kind in options.kinds or kinds:
            library, read = kinds[kind]
            counts, sound = Counter(), _outcome(read, Attack("whole", *whole[kind]).write(Path(folder, "sound")))
            for number, attack in enumerate(attacks_of(kind, whole[kind], options.inputs, seed=1)[NO_FILES:]):
                if not attack.label.endswith(COSTLY):
                    path = attack.write(Path(folder, str(number)))
                    counts[_compared(_outcome(READERS[kind], path), _outcome(read, path), sound)] += 1
            table.add(kind=kind, library=library, inputs=counts.total(), **counts)
    if not options.quick:
        _packages(report)
        _harmonics(report)


def _readers():
    """kind -> (library, what reads it there)."""
    import gsply
    import imagecodecs
    import pycolmap
    import trimesh

    from splat2mesh.scene.meshfile import checked_mesh
    from splat2mesh.scene.surfaces import UncheckedMesh

    splats = {"spz": gsply.read_spz, "sog": gsply.sogread}

    def read_mesh(path):
        found = trimesh.load(path, process=False, force="mesh")
        return checked_mesh(UncheckedMesh(np.asarray(found.vertices), np.asarray(found.faces)), path)

    def read_cameras(path):
        found = pycolmap.Reconstruction(str(path)).images.values()
        return [(image.cam_from_world().matrix(), image.camera.params) for image in found] or None

    found = {
        f"mesh.{kind}": ("trimesh", read_mesh)
        for kind in ("ply", "ascii.ply", "obj", "stl", "ascii.stl", "glb", "gltf")
    }
    for kind in ("ply", "ascii.ply", "compressed.ply", "spz", "sog"):
        found[f"splat.{kind}"] = "gsply", splats.get(kind, gsply.plyread)
    for kind in ("hdr", "plain.hdr"):
        found[f"light.{kind}"] = "imagecodecs", lambda path: imagecodecs.rgbe_decode(path.read_bytes())
    for kind in ("colmap", "colmap.txt"):
        found[kind] = "pycolmap", read_cameras
    return found


def _compared(ours, theirs, sound):
    """One of OUTCOMES."""
    if theirs in ("hang", "crash"):
        return theirs
    if "refused" in (ours, theirs):
        alone = "theirs_same" if theirs == sound else "theirs_other"
        return "both_refuse" if ours == theirs else "ours_alone" if theirs == "refused" else alone
    return "both_read"


def _outcome(read, path):
    """A digest of the result, or refused, hang or crash; in a process that may die."""
    from attacks import content_of

    answer, sink = os.pipe()
    child = os.fork()
    if not child:
        signal.alarm(SECONDS)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = read(path)
            os.write(sink, b"refused" if found is None else content_of(found).encode())
        except BaseException:
            os.write(sink, b"refused")
        os._exit(0)
    os.close(sink)
    with open(answer, "rb") as file:
        found = file.read().decode()
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status):
        return "hang" if os.WTERMSIG(status) == signal.SIGALRM else "crash"
    return found


def _packages(report):
    table = report.table("packages", name="<14", megabytes=".1f", import_s=".2f")
    for name in ("trimesh", "gsply", "pycolmap", "shtab"):
        size = sum(file.size or 0 for file in distribution(name).files)
        code = f"import numpy, time; t = time.perf_counter(); import {name}; print(time.perf_counter() - t)"
        runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, check=True) for _ in range(3)]
        table.add(name=name, megabytes=size / 1e6, import_s=min(json.loads(each.stdout) for each in runs))


def _harmonics(report):
    from scipy.special import sph_harm_y_all

    from relight.sh.harmonics import evaluate

    table = report.table("harmonics of 100,000 directions", bands="d", ours_ms=".1f", scipy_ms=".1f", difference=".1e")
    directions = np.random.default_rng(0).normal(size=(100_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for bands in (3, 8, 10):
        ours, seconds = _timed(lambda bands=bands: evaluate(directions, bands))
        x, y, z = directions.T
        polar, angle = np.arccos(z), np.arctan2(y, x)
        scipys, slower = _timed(lambda bands=bands, a=(polar, angle): sph_harm_y_all(bands - 1, bands - 1, *a))
        degree = bands - 1
        zonal = np.abs(ours[:, degree * (degree + 1)] - scipys[degree, 0].real).max()
        table.add(bands=bands, ours_ms=1e3 * seconds, scipy_ms=1e3 * slower, difference=zonal)


def _timed(work):
    """The result, and the seconds of the fastest of three runs."""
    seconds = []
    for _ in range(3):
        begun = time.perf_counter()
        found = work()
        seconds.append(time.perf_counter() - begun)
    return found, min(seconds)
