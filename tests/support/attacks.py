"""Hostile inputs for every reader: whole files, and what becomes of them under seeded damage.

    for attack in attacks_of("obj", whole_files(folder)["obj"], 100, seed=0): attack.write(somewhere)

`READERS` reads a kind, `content_of` is a digest of what was read, by which a file that has a checksum and loads with
other content is found out.
"""

import hashlib
import json
import os
import shutil
import struct
import zipfile
import zlib
from dataclasses import dataclass, fields, is_dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np


def _splats(path):
    from splat2mesh.splats.formats import read_splats

    return read_splats(path)


def _mesh(path):
    from splat2mesh.scene.meshfile import read_mesh

    return read_mesh(path)


def _light(path):
    from relight.light.environment import Environment

    found = Environment.load(path)
    assert np.isfinite(found.radiance).all()
    return found.radiance


def _scene(path):
    from splat2mesh.scene.scene import Scene

    scene = Scene.load(path)
    rest = scene.scene_from_splat, scene.background_splats, scene.source["sha256"], scene.preview_camera
    return scene.vertices, scene.normals, scene.faces, scene.colors_srgb, *rest


def _animation(path):
    from relight.animation.animation import Animation

    animation = Animation(path)
    return [animation.at(share * animation.duration_s) for share in (0.0, 0.5, 1.0)]


def _cameras(path):
    from splat2mesh.views.cameras import trained_views

    return [view.camera_from_world for view in trained_views(path, "x.ply", _few_splats())]


def _layout(path):
    from splat2mesh.layout import read_layout

    return [placement.scene_from_upright for placement in read_layout(path)]


def _albedo(path):
    from relight.engine.appearance import _read

    return _read(path, 12)


def _object(path):
    from relight.insert.asked import AskedInsert
    from relight.insert.objects import read_object

    found = read_object(AskedInsert(str(path), (0.0, 0.0, 0.0)))
    return found.joined("vertices"), found.joined("albedo"), found.faces


def _cache(path):
    from relight.transfer.store import Cache

    cache = Cache(path, "geometry")
    return cache.restored(lambda arrays: arrays["transfer"], "transfer", "raytraced", 3, 8, 0) is not None


_USD = ("usdc", "usda") if find_spec("pxr") else ()

READERS = {
    **{f"splat.{kind}": _splats for kind in ("ply", "ascii.ply", "compressed.ply", "splat", "spz", "sog")},
    **{f"splat.{kind}": _splats for kind in ("utm.ply", "records.spz", "ksplat", "glb", "spz.glb", "lcc", *_USD)},
    "splat.folder": _splats,
    "splat.streamed": _splats,
    "splat.checkpoints": _splats,
    **{f"mesh.{kind}": _mesh for kind in ("ply", "ascii.ply", "obj", "stl", "ascii.stl", "glb", "gltf")},
    **{f"light.{kind}": _light for kind in ("exr", "piz.exr", "tiled.exr", "hdr", "plain.hdr")},
    "scene": _scene,
    "animation": _animation,
    "cameras.json": _cameras,
    "transforms.json": _cameras,
    "colmap": _cameras,
    "colmap.txt": _cameras,
    "layout": _layout,
    "albedo": _albedo,
    "object": _object,
    "cache": _cache,
}
SUMMED = ("scene", "splat.spz", "splat.records.spz")
"""Kinds whose files carry a checksum of their content."""


@dataclass
class Attack:
    """One hostile input. files: name -> bytes, or what makes it at a path. entry: what is read. summed: digest of
    the whole content where it must load as that or not at all."""

    label: str
    files: dict
    entry: str
    summed: str | None = None

    def write(self, folder):
        """Write the files; the path to read."""
        shutil.rmtree(folder, ignore_errors=True)
        for name, content in self.files.items():
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            if callable(content):
                content(path)
            else:
                path.write_bytes(content)
        return Path(folder, self.entry)


def content_of(found):
    """A digest of arrays, whatever holds them."""
    digest = hashlib.sha256()

    def take(value):
        if isinstance(value, np.ndarray):
            digest.update(str((value.shape, value.dtype)).encode() + np.ascontiguousarray(value).tobytes())
        elif is_dataclass(value):
            for each in fields(value):
                take(getattr(value, each.name))
        elif isinstance(value, (list, tuple)):
            for each in value:
                take(each)
        else:
            digest.update(repr(value).encode())

    take(found)
    return digest.hexdigest()


def attacks_of(kind, whole, count, seed):
    """`count` inputs of a kind: lies and what is no file first, damage after. whole: (files, entry) of the kind."""
    files, entry = whole
    rng = np.random.default_rng(seed)
    digest = None
    found = [*_no_files(entry), *lies(kind, files, entry)][:count]
    while len(found) < count:
        names = [name for name in files if files[name]]
        name = names[rng.integers(len(names))]
        changed, label = damaged(files[name], rng)
        found.append(Attack(f"{name} {label}", files | {name: changed}, entry, digest))
    if kind in SUMMED:
        digest = _digest_of(kind, files, entry)
        for attack in found:
            attack.summed = digest
    return found


def _digest_of(kind, files, entry):
    import tempfile
    import warnings

    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return content_of(READERS[kind](Attack("", files, entry).write(Path(folder, "whole"))))


def damaged(content, rng):
    """The bytes with one of several kinds of damage, and which."""
    changed, size = bytearray(content), len(content)
    where = int(rng.integers(min(size, (64, 600, size)[rng.integers(3)])))
    match rng.integers(9):
        case 0:
            return content[: int(rng.integers(size))], "cut"
        case 1:
            changed[where] ^= 1 << int(rng.integers(8))
            return bytes(changed), f"bit at {where}"
        case 2:
            for _ in range(int(rng.integers(1, 8))):
                changed[int(rng.integers(size))] = int(rng.integers(256))
            return bytes(changed), "bytes"
        case 3:
            changed[where:where] = rng.bytes(int(rng.integers(1, 9)))
            return bytes(changed), f"insertion at {where}"
        case 4:
            del changed[where : where + int(rng.integers(1, 9))]
            return bytes(changed), f"deletion at {where}"
        case 5:
            value = (0, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000, 0x00FFFFFF)[rng.integers(5)]
            changed[where : where + 4] = struct.pack("<I", value)
            return bytes(changed), f"{value:#x} at {where}"
        case 6:
            digits = [at for at in range(min(size, 4000)) if 48 <= changed[at] <= 57]
            if digits:
                at = digits[rng.integers(len(digits))]
                text = (b"99999999999", b"-1", b"1e39", b"nan", b"4294967296", b"0", b"-7", b"1e309", b"0.5")[
                    rng.integers(9)
                ]
                changed[at : at + 1] = text
                return bytes(changed), f"{text.decode()} at {at}"
            return content + rng.bytes(7), "more at the end"
        case 7:
            other = int(rng.integers(size))
            length = int(rng.integers(1, 40))
            changed[where : where + length] = content[other : other + length]
            return bytes(changed), "copied within"
        case _:
            return content + rng.bytes(int(rng.integers(1, 64))), "more at the end"


def _no_files(entry):
    def pipe(path):
        os.mkfifo(path)

    yield Attack("a pipe", {entry: pipe}, entry)
    yield Attack("a device", {entry: lambda path: path.symlink_to("/dev/zero")}, entry)
    yield Attack("a folder", {entry: lambda path: path.mkdir()}, entry)
    yield Attack("nothing", {"other": b""}, entry)
    yield Attack("an empty file", {entry: b""}, entry)
    yield Attack("a link to itself", {entry: lambda path: path.symlink_to(path)}, entry)
    yield Attack("deep JSON", {entry: b"[" * 100_000 + b"]" * 100_000}, entry)
    yield Attack("a long name", {"other": b""}, "n" * 300 + Path(entry).suffix)
    yield Attack("a NUL in the name", {"other": b""}, "a\0b" + Path(entry).suffix)


def lies(kind, files, entry):
    """Files whose headers announce what is not there, by kind."""
    if kind == "splat.sog":
        for names, size in ((["meta.json"], 1 << 28), (["means_l.webp", "quats.webp"], 1 << 29)):
            bomb = _later(_zip_bomb, files[entry], names, size)
            yield Attack(f"{names[0]} of {size >> 20} MB of zeros", {entry: bomb}, entry)
    elif kind == "splat.spz":
        for count in (48_000_000, 1 << 31):
            yield Attack(f"{count} splats", {entry: _later(_spz_bomb, count)}, entry)
    elif kind == "splat.ksplat":
        for at in (4, 16, 4096, 4100, 4104, 4108, 4128, 4132):
            yield Attack(f"4 G at {at}", {entry: _with_number(files[entry], at, 0xFFFFFFFF)}, entry)
    elif kind == "splat.lcc":
        for at, value in ((4, 0x7FFFFFFF), (8, 0xFFFFFFFF), (12, 0x7FFFFFFF), (8, 7)):
            index = _with_number(files["scene/index.bin"], at, value)
            yield Attack(f"{value:#x} at {at}", files | {"scene/index.bin": index}, entry)
        meta = json.loads(files[entry])
        for change in (
            {"totalLevel": 1 << 40},
            {"splats": [1 << 60, 1]},
            {"attributes": {"a": 1}},
            {"attributes": [[]]},
        ):
            yield Attack(f"{change}", files | {entry: json.dumps(meta | change).encode()}, entry)
    elif kind in ("mesh.glb", "animation", "splat.glb", "object"):
        data = files[entry]
        yield Attack("4 GB of JSON", {entry: data[:12] + struct.pack("<I", 0xFFFFFFF0) + data[16:]}, entry)
        for change in _gltf_lies():
            yield Attack(f"glTF {change.__name__}", {entry: _changed_glb(data, change)}, entry)
    elif kind == "mesh.stl":
        yield Attack("4 G facets", {entry: b"x" * 80 + struct.pack("<I", 0xFFFFFFFF) + bytes(500)}, entry)
    elif kind == "mesh.obj":
        corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
        for face in ("f 1 2 -9", "f 1 2 99999999", "f 0 1 2", "f 1", "f", "f 1/9/9 2/9/9 3/9/9", "f 1 2 3e", "f a b c"):
            yield Attack(face, {entry: f"{corners}{face}\n".encode()}, entry)
        yield Attack("100,000 identical triangles", {entry: (corners + "f 1 2 3\n" * 100_000).encode()}, entry)
        yield Attack("a vertex at 3e38", {entry: (corners + "v 3e38 0 0\nf 1 2 4\n").encode()}, entry)
        library = f"mtllib ../../../../dev/zero\nusemtl a\n{corners}f 1 2 3\n"
        yield Attack("a library that is a device", {entry: library.encode()}, entry)
    elif kind == "mesh.ply":
        for corner_count in (0, 1, 255):
            header = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
            header += b"property float x\nproperty float y\nproperty float z\n"
            header += b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
            yield Attack(
                f"a face of {corner_count}",
                {entry: header + bytes(36) + bytes([corner_count]) + bytes(4 * corner_count)},
                entry,
            )
    elif kind == "light.exr":
        for window in ("displayWindow", "dataWindow"):
            at = files[entry].index(window.encode() + b"\0box2i\0") + len(window) + 7 + 4
            for right, bottom in ((19999, 9999), (99999, 99999), (-5, -5), (2**31 - 1, 2**31 - 1)):
                changed = files[entry][: at + 8] + struct.pack("<ii", right, bottom) + files[entry][at + 16 :]
                yield Attack(f"{window} to {right}", {entry: changed}, entry)
    elif kind == "light.hdr":
        head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"
        yield Attack("huge", {entry: head + b"-Y 999999 +X 999999\n" + bytes(100)}, entry)
        yield Attack("old runs", {entry: head + b"-Y 5000 +X 5000\n" + b"\2\2\2\x80" + b"\1\1\1\xff" * 4000}, entry)
    elif kind == "scene":
        meta = json.loads(files["scene/scene.json"])
        for name in ("../scene.json", "/dev/zero", "..\\x.ply", "a/../../x", "", None, 5):
            changed = json.loads(files["scene/scene.json"])
            changed["chunks"][0]["file"] = name
            yield Attack(f"a chunk named {name!r}", files | {"scene/scene.json": json.dumps(changed).encode()}, entry)
        for key in meta:
            yield Attack(f"{key} null", files | {"scene/scene.json": json.dumps(meta | {key: None}).encode()}, entry)
        camera = {"eye": [1e300, 0, 0], "target": [0, 0, 0], "up": [0, 1, 0], "fov_deg": 40}
        yield Attack(
            "an eye at 1e300",
            files | {"scene/scene.json": json.dumps(meta | {"preview_camera": camera}).encode()},
            entry,
        )
    elif kind == "albedo":
        header = b"\x93NUMPY\x01\x00v\x00{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999, 3), }"
        yield Attack("a shape of terabytes", {entry: header.ljust(127) + b"\n" + bytes(50)}, entry)
        yield Attack(
            "a pickle",
            {
                entry: b"\x93NUMPY\x01\x00v\x00"
                + b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }".ljust(117)
                + b"\ncos\nsystem\n(S'true'\ntR."
            },
            entry,
        )


def _gltf_lies():
    def dangling_mesh(document):
        document["nodes"][0]["mesh"] = 99

    def negative_accessor(document):
        document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = -1

    def count_of_terabytes(document):
        document["accessors"][0] |= {"count": 10**12}
        document["accessors"][0].pop("bufferView", None)

    def unknown_extension(document):
        document["extensionsRequired"] = ["KHR_draco_mesh_compression"]

    def a_node_its_own_child(document):
        document["nodes"][0]["children"] = [0]

    def a_buffer_elsewhere(document):
        document["buffers"][0]["uri"] = "../../../../dev/zero"

    def repeated_without_end(document):
        document["nodes"] += [dict(document["nodes"][0]) for _ in range(200_000)]
        for node in document["nodes"]:
            node.pop("children", None)
        document["scenes"] = [{"nodes": list(range(len(document["nodes"])))}]

    def text_for_numbers(document):
        document["accessors"][0]["count"] = "many"

    def a_skin_without_joints(document):
        document["nodes"][0]["skin"] = 0
        document["skins"] = [{"joints": [99]}]

    return [value for value in locals().values() if callable(value)]


def _changed_glb(data, change):
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    return data[:8] + struct.pack("<III", 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


def _with_number(data, at, value):
    return data[:at] + struct.pack("<I", value) + data[at + 4 :]


def _later(make, *arguments):
    """Writes what `make` gives, made only when it is written: bombs take seconds."""
    return lambda path: path.write_bytes(make(*arguments))


def _spz_bomb(count):
    packer = zlib.compressobj(1, zlib.DEFLATED, 31)
    parts = [packer.compress(struct.pack("<4sIIBBBB", b"NGSP", 3, count, 3, 12, 0, 0))]
    parts += [packer.compress(bytes(1 << 20)) for _ in range(300)]
    return b"".join([*parts, packer.flush()])


def _zip_bomb(bundle, names, size):
    import io

    found = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(bundle)) as whole, zipfile.ZipFile(found, "w", zipfile.ZIP_DEFLATED) as changed:
        for name in whole.namelist():
            changed.writestr(name, bytes(size) if name in names else whole.read(name))
    return found.getvalue()


def _few_splats():
    from splat_samples import make_splats

    return make_splats(60, 0)


def whole_files(folder):
    """Whole files of every kind in READERS: kind -> (files by name, what to read)."""
    from attack_samples import make

    folder.mkdir(parents=True, exist_ok=True)
    return make(folder)
