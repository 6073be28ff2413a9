"""docs/decisions.md: what a library reads in silence, or gets wrong, is still so, and ours still refuses or reads it.

Where such a test fails because the library was mended, its row of the document is to be decided again.
"""

import json
import logging
import math
import re
import signal
import struct
import subprocess
import sys
import warnings
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import trimesh
from attack_samples import _glb, _gltf, _grid
from scipy.special import sph_harm_y
from splat_samples import make_splats

from relight.light import environment_files
from relight.sh.harmonics import evaluate
from splat2mesh.base.errors import InputError
from splat2mesh.scene.meshfile import read_mesh
from splat2mesh.splats.formats import read_splats, write_splats

PAGE = Path(__file__).parents[2] / "docs" / "decisions.md"

HEAD = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
HEAD += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
SQUARE = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


def draco():
    points, faces = _grid()
    document, blob = _gltf(points, np.ones_like(points), faces)
    return _glb(document | {"extensionsRequired": ["KHR_draco_mesh_compression"]}, blob)


def a_ring_of_nodes():
    points, faces = _grid()
    document, blob = _gltf(points, np.ones_like(points), faces)
    document["nodes"][0]["children"] = [0]
    return _glb(document, blob)


DAMAGED = {
    "cut.ply": (HEAD + SQUARE + "3 0 1 2\n", (4, 1)),
    "row_lost.ply": (HEAD + "0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n3 0 2 3\n", (4, 1)),
    "flat.obj": ("v 0 0\nv 1 0\nv 1 1\nf 1 2 3\n", (3, 1)),
    "packed.glb": (draco(), (32, 36)),
    "ring.glb": (a_ring_of_nodes(), (16, 18)),
}
"""A file that is damaged or asks for what is unknown, and how many vertices and faces trimesh reads of it."""


def stored(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def read_by_trimesh(path):
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    return trimesh.load(path, process=False, force="mesh")


@pytest.mark.parametrize("name", DAMAGED)
def test_trimesh_reads_in_part_what_is_refused_here(tmp_path, name):
    content, counts = DAMAGED[name]
    path = stored(tmp_path, name, content)
    found = read_by_trimesh(path)
    assert (len(found.vertices), len(found.faces)) == counts
    with pytest.raises(InputError, match=re.escape(str(path))):
        read_mesh(path)


def test_trimesh_leaves_out_what_a_sparse_accessor_replaces(tmp_path):
    points, faces = _grid()
    document, blob = _gltf(points, np.ones_like(points), faces)
    document["nodes"] = [{"mesh": 0}]
    end, place = len(blob), np.array([5, 6, 7], "<f4")
    views = document["bufferViews"]
    views += [{"buffer": 0, "byteOffset": end, "byteLength": 2}, {"buffer": 0, "byteOffset": end + 4, "byteLength": 12}]
    indices, values = {"bufferView": len(views) - 2, "componentType": 5123}, {"bufferView": len(views) - 1}
    document["accessors"][0]["sparse"] = {"count": 1, "indices": indices, "values": values}
    document["buffers"] = [{"byteLength": end + 16}]
    path = stored(tmp_path, "a.glb", _glb(document, blob + bytes(4) + place.tobytes()))
    assert (read_mesh(path).vertices == place).all(axis=1).any()
    assert not (np.asarray(read_by_trimesh(path).vertices) == place).all(axis=1).any()


def test_trimesh_writes_colours_into_a_glb_as_they_are():
    """glTF holds linear colours: a grey of 128 in sRGB is 55 there."""
    points, faces = _grid()
    grey = np.full((len(points), 4), 128, np.uint8)
    content = trimesh.Trimesh(points, faces, vertex_colors=grey, process=False).export(file_type="glb")
    document = json.loads(content[20 : 20 + struct.unpack("<I", content[12:16])[0]])
    colors = [each for each in document["accessors"] if each["type"] == "VEC4"]
    assert [each["max"][0] for each in colors] == [128]


def test_gsply_reads_garbage_where_a_row_holds_a_byte_more(tmp_path):
    import gsply

    splats = make_splats(40, 1)
    write_splats(tmp_path / "whole.ply", splats)
    head, body = (tmp_path / "whole.ply").read_bytes().split(b"end_header\n", 1)
    rows = np.frombuffer(body, "u1").reshape(40, -1)
    rows = np.concatenate([rows, np.ones((40, 1), np.uint8)], axis=1)
    path = stored(tmp_path, "a.ply", head + b"property uchar flag\nend_header\n" + rows.tobytes())
    np.testing.assert_array_equal(read_splats(path).means, splats.means)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        found = np.asarray(gsply.plyread(path).means)
    assert found.shape == splats.means.shape and not np.allclose(found[1:], splats.means[1:])


@pytest.mark.parametrize("kind", ["double", "big endian", "ascii"])
def test_gsply_refuses_what_is_read_here(tmp_path, kind):
    import gsply

    splats = make_splats(40, 1)
    write_splats(tmp_path / "whole.ply", splats)
    head, body = (tmp_path / "whole.ply").read_bytes().split(b"end_header\n", 1)
    rows = np.frombuffer(body, "<f4").reshape(40, -1)
    if kind == "double":
        head, body = head.replace(b"property float", b"property double"), rows.astype("<f8").tobytes()
    elif kind == "big endian":
        head, body = head.replace(b"little", b"big"), rows.astype(">f4").tobytes()
    else:
        head = head.replace(b"binary_little_endian", b"ascii")
        body = "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()).encode()
    path = stored(tmp_path, "a.ply", head + b"end_header\n" + body)
    np.testing.assert_array_equal(read_splats(path).means, splats.means)
    with pytest.raises(ValueError, match="Unsupported PLY"):
        gsply.plyread(path)


RADIANCE = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n"
PIXEL = bytes([128, 64, 32, 129])


def test_imagecodecs_ignores_the_exposure_of_a_radiance_picture():
    content = RADIANCE + b"EXPOSURE=4\n\n-Y 1 +X 2\n" + 2 * PIXEL
    np.testing.assert_array_equal(4.0 * environment_files.decode(content, "a"), imagecodecs.rgbe_decode(content))


def test_imagecodecs_reads_no_rows_from_below():
    content = RADIANCE + b"\n+Y 1 +X 2\n" + 2 * PIXEL
    assert (environment_files.decode(content, "a") == [1.0, 0.5, 0.25]).all()
    with pytest.raises(imagecodecs.RgbeError):
        imagecodecs.rgbe_decode(content)


HANDLED = """
import os, signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: os._exit(7))
import {module}
os.kill(os.getpid(), signal.SIGTERM)
time.sleep(60)
"""


@pytest.mark.parametrize(("module", "ended"), [("pycolmap", -signal.SIGTERM), ("splat2mesh.views.colmap", 7)])
def test_importing_pycolmap_takes_the_signal_from_who_would_stop_in_order(module, ended):
    code = HANDLED.format(module=module)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=120, cwd=PAGE.parents[1])
    assert done.returncode == ended


def test_scipys_harmonics_take_angles_which_lose_what_lies_near_the_pole():
    """Index 3 is sqrt(3 / 4 pi) x; the cosine of the polar angle is 1 from 1e-8 on."""
    exact = math.sqrt(0.75 / math.pi) * 1e-9
    assert evaluate(np.array([[1e-9, 0.0, 1.0]]), 2)[0, 3] == pytest.approx(exact, rel=1e-12)
    assert sph_harm_y(1, 1, np.arccos(1.0), 0.0) == 0.0


def test_the_page_has_every_row_and_names_tests_that_are_there():
    text = PAGE.read_text("utf-8")
    for library in ("trimesh", "gsply", "imagecodecs", "pycolmap", "scipy", "shtab", "diskcache"):
        assert library in text, library
    here = Path(__file__).read_text("utf-8")
    assert all(f"def {name}(" in here for name in re.findall(r"`(test_\w+)`", text))
