"""Readers meet damaged files: they read the rest, or raise InputError; no other exception, whatever the bytes."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from seeded import bounded
from splat_samples import make_splats

from relight import Environment
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.meshfile import read_mesh
from splat2mesh.splats.formats import read_splats, write_splats
from splat2mesh.splats.formats.ply import Ply

SCALARS = {"char": "i1", "uint8": "u1", "short": "i2", "ushort": "u2"}
SCALARS |= {"int": "i4", "uint32": "u4", "float": "f4", "double": "f8"}
ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}

names = st.sampled_from([*"abcdefgxyz", "f_dc_0", "scale_1"])
properties = st.dictionaries(names, st.sampled_from(sorted(SCALARS)), min_size=1, max_size=6).map(
    lambda d: [*d.items()]
)
elements = st.lists(st.tuples(st.integers(0, 4), properties), min_size=1, max_size=3)


def written(format, parts, seed):
    """(bytes, {element: rows}) of a PLY file of these elements with random values that ascii holds exactly."""
    rng, lines, body, rows = np.random.default_rng(seed), [f"ply\nformat {format} 1.0"], b"", {}
    for index, (count, properties) in enumerate(parts):
        dtype = np.dtype([(name, ORDERS[format] + SCALARS[kind]) for name, kind in properties])
        values = np.zeros(count, dtype)
        for name, _ in properties:
            values[name] = rng.integers(0, 100, count)
        lines.append(f"element e{index} {count}")
        lines += [f"property {kind} {name}" for name, kind in properties]
        text = "".join(" ".join(str(value) for value in row) + "\n" for row in values.tolist())
        body += text.encode() if format == "ascii" else values.tobytes()
        rows[f"e{index}"] = values
    return ("\n".join(lines) + "\nend_header\n").encode() + body, rows


@bounded
@given(st.sampled_from(sorted(ORDERS)), elements, st.integers(0, 2**16))
def test_any_order_type_and_byte_order_is_read(tmp_path_factory, format, parts, seed):
    data, rows = written(format, parts, seed)
    path = stored(tmp_path_factory, "any.ply", data)
    ply = Ply.open(path)
    assert list(ply.elements) == list(rows)
    for name, expected in rows.items():
        found = ply.rows(name)
        assert found.dtype.names == expected.dtype.names and len(found) == len(expected)
        for key in expected.dtype.names:
            np.testing.assert_array_equal(found[key], expected[key])


@bounded
@given(st.sampled_from(sorted(ORDERS)), elements, st.integers(0, 2**16), st.data())
def test_a_changed_header_is_refused_or_read(tmp_path_factory, format, parts, seed, data):
    content, _ = written(format, parts, seed)
    end = content.index(b"end_header\n") + 11
    head, body = bytearray(content[:end]), content[end:]
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(head) - 1))
        match data.draw(st.sampled_from(["flip", "drop", "insert"])):
            case "flip":
                head[at] = data.draw(st.integers(0, 255))
            case "drop":
                del head[at]
            case "insert":
                head[at:at] = data.draw(st.binary(min_size=1, max_size=3))
    path = stored(tmp_path_factory, "changed.ply", bytes(head) + body)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            ply = Ply.open(path)
            for name, element in ply.elements.items():
                assert element.has_lists or len(ply.rows(name)) in (0, element.count)
    except InputError as error:
        assert str(path) in str(error)


@pytest.fixture(scope="module")
def intact(tmp_path_factory):
    """Files of every kind that can be damaged, by suffix."""
    folder, files = tmp_path_factory.mktemp("intact"), {}
    splats = make_splats(40, 1)
    splats = replace(splats, sh=0.1 * splats.sh)  # within what every kind can hold
    for kind in ("ply", "compressed.ply", "spz"):
        write_splats(folder / f"whole.{kind}", splats, kind)
        files[kind] = (folder / f"whole.{kind}").read_bytes()
    rows = np.zeros(40, [("mean", "<f4", 3), ("scale", "<f4", 3), ("color", "u1", 4), ("quat", "u1", 4)])
    rows["mean"], rows["scale"], rows["color"], rows["quat"] = splats.means, splats.scales, 200, 128
    files["splat"] = rows.tobytes()
    for suffix in ("hdr", "exr"):
        files[suffix] = light_file(folder / f"light.{suffix}")
    points, corners = np.eye(4, 3, dtype=np.float32), np.array([[0, 1, 2], [1, 2, 3]], np.int32)
    for suffix in ("obj", "stl", "glb"):
        files[suffix] = mesh_file(folder / f"mesh.{suffix}", points, corners)
    return files


def light_file(path):
    pixels = np.random.default_rng(0).random((8, 16, 3), np.float32)
    if path.suffix == ".exr":
        import OpenEXR

        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"RGB": pixels}).write(str(path))
    else:
        import imagecodecs

        path.write_bytes(imagecodecs.rgbe_encode(pixels))
    return path.read_bytes()


def mesh_file(path, points, corners):
    import open3d as o3d

    vertices, faces = o3d.utility.Vector3dVector(points.astype(float)), o3d.utility.Vector3iVector(corners)
    mesh = o3d.geometry.TriangleMesh(vertices, faces)
    mesh.compute_vertex_normals()
    mesh.compute_triangle_normals()
    o3d.io.write_triangle_mesh(str(path), mesh)
    return path.read_bytes()


def damaged(content, data):
    """The bytes cut short, or some of them changed."""
    if data.draw(st.booleans()):
        return content[: data.draw(st.integers(0, len(content) - 1))]
    changed = bytearray(content)
    for _ in range(data.draw(st.integers(1, 6))):
        # Headers stand at the front, and are what most can go wrong with.
        most = data.draw(st.sampled_from([64, 512, len(content)]))
        changed[data.draw(st.integers(0, min(most, len(content)) - 1))] = data.draw(st.integers(0, 255))
    return bytes(changed)


def read_or_refused(read, path):
    """What a reader makes of a file, None where it raises InputError; counted warnings are in order."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            return read(path)
    except InputError as error:
        assert "\n" not in str(error)
        return None


@pytest.mark.parametrize("kind", ["ply", "compressed.ply", "splat", "spz"])
@bounded
@given(st.data())
def test_damaged_splats_are_refused_or_read(tmp_path_factory, intact, kind, data):
    path = stored(tmp_path_factory, f"damaged.{kind}", damaged(intact[kind], data))
    splats = read_or_refused(read_splats, path)
    assert splats is None or splats.means.shape == (len(splats), 3)


@pytest.mark.parametrize("suffix", ["hdr", "exr"])
@bounded
@given(st.data())
def test_damaged_lights_are_refused_or_read(tmp_path_factory, intact, suffix, data):
    path = stored(tmp_path_factory, f"damaged.{suffix}", damaged(intact[suffix], data))
    light = read_or_refused(Environment.load, path)
    assert light is None or np.isfinite(light.radiance).all()


@pytest.mark.parametrize("suffix", ["obj", "stl", "glb"])
@bounded
@given(st.data())
def test_damaged_meshes_are_refused_or_read(tmp_path_factory, intact, suffix, data):
    path = stored(tmp_path_factory, f"damaged.{suffix}", damaged(intact[suffix], data))
    mesh = read_or_refused(read_mesh, path)
    assert mesh is None or mesh.faces.max(initial=-1) < len(mesh.vertices)


def stored(factory, name, data):
    """A path that no earlier example mapped into memory."""
    folder = factory.mktemp("example", numbered=True)
    (folder / name).write_bytes(data)
    return folder / name
