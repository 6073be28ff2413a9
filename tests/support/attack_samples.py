"""Small whole files of every kind that is read, for `attacks` to damage."""

import gzip
import json
import struct
import warnings
import zipfile
from dataclasses import replace

import numpy as np
from sog_samples import palette_splats, sog_parts
from splat_samples import make_splats


def make(folder):
    """kind -> (dict of name -> bytes, name of what is read)."""
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for maker in (_splats, _meshes, _lights, _scenes, _cameras, _others):
            found |= maker(folder)
    return found


def _splats(folder):
    from splat2mesh.splats.formats import write_splats

    splats = make_splats(40, 1)
    splats = replace(splats, sh=0.1 * splats.sh)  # within what every kind can hold
    found = {}
    for kind in ("ply", "compressed.ply", "spz"):
        write_splats(folder / f"whole.{kind}", splats, kind)
        found[f"splat.{kind}"] = {f"a.{kind}": (folder / f"whole.{kind}").read_bytes()}, f"a.{kind}"
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
    names += ["rot_0", "rot_1", "rot_2", "rot_3"]
    text = "ply\nformat ascii 1.0\nelement vertex 9\n" + "".join(f"property float {name}\n" for name in names)
    rows = np.random.default_rng(0).normal(size=(9, len(names)))
    text += "end_header\n" + "".join(" ".join(f"{value:.4f}" for value in row) + "\n" for row in rows)
    found["splat.ascii.ply"] = {"a.ply": text.encode()}, "a.ply"
    rows = np.zeros(40, [("mean", "<f4", 3), ("scale", "<f4", 3), ("color", "u1", 4), ("quat", "u1", 4)])
    rows["mean"], rows["scale"], rows["color"], rows["quat"] = splats.means, splats.scales, 200, 128
    rows["quat"][:, 0] = 255
    found["splat.splat"] = {"a.splat": rows.tobytes()}, "a.splat"
    parts = sog_parts(palette_splats(120, 1), 2)
    with zipfile.ZipFile(folder / "whole.sog", "w") as bundle:
        for name, data in parts.items():
            bundle.writestr(name, data)
    found["splat.sog"] = {"a.sog": (folder / "whole.sog").read_bytes()}, "a.sog"
    found["splat.folder"] = {f"sog/{name}": data for name, data in parts.items()}, "sog/meta.json"
    tile = sog_parts(palette_splats(30, 0), 1)
    leaf = {"lods": {"0": {"file": 0, "offset": 0, "count": 120}, "1": {"file": 1, "offset": 0, "count": 30}}}
    meta = {"lodLevels": 2, "filenames": ["0_0/meta.json", "1_0/meta.json"], "tree": {"children": [leaf]}}
    files = {"all/lod-meta.json": json.dumps(meta | {"version": 1, "counts": [120, 30]}).encode()}
    files |= {f"all/0_0/{name}": data for name, data in parts.items()}
    files |= {f"all/1_0/{name}": data for name, data in tile.items()}
    found["splat.streamed"] = files, "all/lod-meta.json"
    return found | _newer_splats(folder, splats)


def _newer_splats(folder, splats):
    """Kinds that the package reads and does not write."""
    from scan_samples import ksplat_bytes, write_lcc
    from splat_gltf import attributes_of, splat_glb, spz_glb

    from splat2mesh.splats.facts import FileFacts
    from splat2mesh.splats.formats import write_splats

    write_splats(folder / "utm.ply", replace(splats, facts=FileFacts(offset=(5e5, 5e6, 300.0))))
    found = {"splat.utm.ply": ({"a.ply": (folder / "utm.ply").read_bytes()}, "a.ply")}
    spz = (folder / "whole.spz").read_bytes()
    found["splat.records.spz"] = {"a.spz": _with_records(spz)}, "a.spz"
    found["splat.ksplat"] = {"a.ksplat": ksplat_bytes(splats, 1, bucket=16)}, "a.ksplat"
    found["splat.glb"] = {"a.glb": splat_glb(attributes_of(splats))}, "a.glb"
    found["splat.spz.glb"] = {"a.glb": spz_glb(spz)}, "a.glb"
    write_lcc(folder / "lcc", [palette_splats(30, 3), palette_splats(10, 3)], palette_splats(5, 3))
    scene = {f"scene/{each.name}": each.read_bytes() for each in (folder / "lcc").iterdir()}
    found["splat.lcc"] = scene, "scene/meta.lcc"
    names = [f"out/point_cloud/iteration_{number}/point_cloud.ply" for number in (7000, 30000)]
    found["splat.checkpoints"] = dict.fromkeys(names, (folder / "whole.ply").read_bytes()), "out"
    return found | _usd_splats(folder, splats)


def _usd_splats(folder, splats):
    try:
        from pxr import Usd, UsdVol, Vt
    except ImportError:
        return {}
    found = {}
    for kind in ("usda", "usdc"):
        stage = Usd.Stage.CreateNew(str(folder / f"splats.{kind}"))
        field = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/a")
        field.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(splats.means))
        sh = np.ascontiguousarray(splats.sh.reshape(-1, 3))
        field.CreateRadianceSphericalHarmonicsCoefficientsAttr(Vt.Vec3fArray.FromNumpy(sh))
        field.CreateRadianceSphericalHarmonicsDegreeAttr(splats.degree)
        stage.GetRootLayer().Save()
        found[f"splat.{kind}"] = {f"a.{kind}": (folder / f"splats.{kind}").read_bytes()}, f"a.{kind}"
    return found


def _with_records(spz):
    """An SPZ of version 3 that says to be in the frame of a PLY."""
    data = bytearray(gzip.decompress(spz))
    data[14] |= 2
    return gzip.compress(bytes(data) + struct.pack("<III", 0xADBE0003, 4, 6), mtime=0)


def _grid(side=4):
    x, y = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    points = np.stack([x, y, 0.1 * np.sin(7 * x + 3 * y)], axis=-1).reshape(-1, 3).astype(np.float32)
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])


def _meshes(folder):
    from splat2mesh.scene.mesh import Mesh, vertex_normals
    from splat2mesh.scene.meshfile import write_mesh_ply

    points, faces = _grid()
    normals = vertex_normals(points, faces)
    mesh = Mesh(points, normals, faces.astype(np.int32), np.full((len(points), 3), 90, np.uint8))
    write_mesh_ply(folder / "whole.mesh.ply", mesh)
    found = {"mesh.ply": ({"a.ply": (folder / "whole.mesh.ply").read_bytes()}, "a.ply")}
    rows = "".join("{} {} {}\n".format(*point) for point in points)
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
    )
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    listed = "".join("3 {} {} {}\n".format(*face) for face in faces)
    found["mesh.ascii.ply"] = {"a.ply": (head + rows + listed).encode()}, "a.ply"
    text = "".join("v {} {} {}\n".format(*point) for point in points) + "vt 0 0\nvt 1 0\n"
    text += "".join("vn {} {} {}\n".format(*normal) for normal in normals) + "usemtl a\n"
    text += "".join("f {0}/1/{0} {1}/2/{1} {2}//{2}\n".format(*(face + 1)) for face in faces)
    found["mesh.obj"] = {"a.obj": text.encode()}, "a.obj"
    facets = b"".join(struct.pack("<12fH", 0, 0, 1, *points[face].ravel(), 0) for face in faces)
    found["mesh.stl"] = {"a.stl": b"made here".ljust(80) + struct.pack("<I", len(faces)) + facets}, "a.stl"
    text = "solid a\n"
    for face in faces:
        corners = "".join("  vertex {} {} {}\n".format(*points[corner]) for corner in face)
        text += f"facet normal 0 0 1\n outer loop\n{corners} endloop\nendfacet\n"
    found["mesh.ascii.stl"] = {"a.stl": (text + "endsolid a\n").encode()}, "a.stl"
    document, blob = _gltf(points, normals, faces)
    found["mesh.glb"] = {"a.glb": _glb(document, blob)}, "a.glb"
    apart = document | {"buffers": [{"byteLength": len(blob), "uri": "a.bin"}]}
    found["mesh.gltf"] = {"a.gltf": json.dumps(apart).encode(), "a.bin": blob}, "a.gltf"
    found["animation"] = {"a.glb": _glb(*_animated(points, normals, faces))}, "a.glb"
    return found


class _Blob:
    def __init__(self):
        self.data, self.views, self.accessors = b"", [], []

    def add(self, array, component, kind):
        self.data += b"\0" * (-len(self.data) % 4)
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes})
        self.data += array.tobytes()
        view = len(self.views) - 1
        self.accessors.append({"bufferView": view, "componentType": component, "count": len(array), "type": kind})
        return len(self.accessors) - 1

    def document(self, **more):
        shared = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
        arrays = {"bufferViews": self.views, "accessors": self.accessors, "buffers": [{"byteLength": len(self.data)}]}
        return shared | arrays | more


def _gltf(points, normals, faces):
    blob = _Blob()
    quantized = np.zeros((len(points), 4), "<u2")
    quantized[:, :3] = np.rint((points - points.min(axis=0)) * 65535)
    attributes = {"POSITION": blob.add(points, 5126, "VEC3"), "NORMAL": blob.add(normals, 5126, "VEC3")}
    primitive = {"attributes": attributes, "indices": blob.add(faces.astype("<u2").ravel(), 5123, "SCALAR")}
    nodes = [{"mesh": 0, "translation": [1, 2, 3], "children": [1]}, {"mesh": 0, "scale": [2, 1, 1]}]
    return blob.document(meshes=[{"primitives": [primitive]}], nodes=nodes), blob.data


def _animated(points, normals, faces):
    blob = _Blob()
    attributes = {"POSITION": blob.add(points, 5126, "VEC3"), "NORMAL": blob.add(normals, 5126, "VEC3")}
    joints, weights = np.zeros((len(points), 4), "u1"), np.zeros((len(points), 4), "<f4")
    joints[::2, 0], weights[:, 0] = 1, 1.0
    attributes |= {"JOINTS_0": blob.add(joints, 5121, "VEC4"), "WEIGHTS_0": blob.add(weights, 5126, "VEC4")}
    target = {"POSITION": blob.add(0.1 * normals, 5126, "VEC3")}
    indices = blob.add(faces.astype("<u4").ravel(), 5125, "SCALAR")
    primitive = {"attributes": attributes, "indices": indices, "targets": [target]}
    times = blob.add(np.array([0.0, 1.0, 2.0], "<f4"), 5126, "SCALAR")
    samplers, channels = [], []
    turns = np.array([[0, 0, 0, 1], [0, 0.6, 0, 0.8], [0, 1, 0, 0]], "<f4")
    for node, path, values, kind in (
        (1, "rotation", turns, "VEC4"),
        (2, "translation", np.eye(3, dtype="<f4"), "VEC3"),
        (0, "weights", np.array([0, 1, 0.5], "<f4"), "SCALAR"),
    ):
        channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
        samplers.append({"input": times, "output": blob.add(values, 5126, kind)})
    nodes = [{"mesh": 0, "skin": 0, "children": [1]}, {"children": [2]}, {"scale": [1, 2, 1]}]
    parts = {"nodes": nodes, "skins": [{"joints": [1, 2]}], "meshes": [{"primitives": [primitive], "weights": [0.5]}]}
    return blob.document(**parts, animations=[{"name": "act", "samplers": samplers, "channels": channels}]), blob.data


def _glb(document, blob):
    text = json.dumps(document).encode()
    text, blob = text + b" " * (-len(text) % 4), blob + b"\0" * (-len(blob) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def _lights(folder):
    import imagecodecs
    import OpenEXR

    pixels = np.random.default_rng(0).random((16, 32, 3), np.float32)
    found = {}
    ways = {"exr": OpenEXR.ZIP_COMPRESSION, "piz.exr": OpenEXR.PIZ_COMPRESSION, "tiled.exr": OpenEXR.ZIPS_COMPRESSION}
    for kind, compression in ways.items():
        header = {"compression": compression, "type": OpenEXR.scanlineimage}
        if kind == "tiled.exr":
            tiles = OpenEXR.TileDescription()
            tiles.xSize = tiles.ySize = 8
            header |= {"type": OpenEXR.tiledimage, "tiles": tiles}
        channels = {"RGB": pixels.astype(np.float16) if kind == "piz.exr" else pixels}
        if kind == "piz.exr":
            header |= {"chromaticities": (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)}
            channels |= {"AO.R": pixels[..., 0].copy(), "AO.G": pixels[..., 1].copy(), "AO.B": pixels[..., 2].copy()}
        OpenEXR.File(header, channels).write(str(folder / f"whole.{kind}"))
        found[f"light.{kind}"] = {"a.exr": (folder / f"whole.{kind}").read_bytes()}, "a.exr"
    found["light.hdr"] = {"a.hdr": imagecodecs.rgbe_encode(pixels)}, "a.hdr"
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2.0\nPRIMARIES=.7 .3 .2 .8 .1 .05 .31 .33\n\n+Y 4 +X 6\n"
    row = bytes([9, 80, 200, 129, 7, 80, 200, 130, 6, 5, 4, 129] * 2)
    found["light.plain.hdr"] = {"a.hdr": head + 4 * row}, "a.hdr"
    return found


def _scenes(folder):
    from splat2mesh.scene.mesh import Mesh, vertex_normals
    from splat2mesh.scene.scene import Scene

    points, faces = _grid(6)
    normals = vertex_normals(points, faces)
    mesh = Mesh(points, normals, faces.astype(np.int32), np.full((len(points), 3), 90, np.uint8))
    camera = {"eye": [0.0, 0.0, 3.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0], "fov_deg": 40.0}
    scene = Scene.from_mesh(mesh, 20, preview_camera=camera, background_splats=np.arange(5))
    scene.source = {"file": "a.ply", "sha256": "0" * 64, "path": "/nowhere/a.ply"}
    scene.save(folder / "scene")
    files = [path for path in sorted((folder / "scene").rglob("*")) if path.is_file()]
    return {"scene": ({f"scene/{path.relative_to(folder / 'scene')}": path.read_bytes() for path in files}, "scene")}


def _cameras(folder):
    pose = np.eye(4)
    pose[2, 3] = -5.0
    size = {"width": 64, "height": 48, "fx": 60.0, "fy": 60.0}
    one = {"id": 0, "img_name": "a", **size, "position": pose[:3, 3].tolist(), "rotation": np.eye(3).tolist()}
    found = {"cameras.json": ({"c.json": json.dumps([one, one | {"id": 1}]).encode()}, "c.json")}
    flipped = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
    frames = [{"file_path": "a.png", "transform_matrix": flipped.tolist()}]
    transforms = {"fl_x": 60.0, "fl_y": 60.0, "cx": 32.0, "cy": 24.0, "w": 64, "h": 48, "frames": frames}
    found["transforms.json"] = (
        {"t.json": json.dumps(transforms | {"applied_transform": np.eye(4)[:3].tolist()}).encode()},
        "t.json",
    )
    cameras = struct.pack("<QIiQQ4d", 1, 1, 1, 64, 48, 60.0, 60.0, 32.0, 24.0)
    images = struct.pack("<Q", 1) + struct.pack("<I7dI", 1, 1, 0, 0, 0, 0, 0, 5, 1) + b"a.png\0" + struct.pack("<Q", 0)
    binary = {"sparse/cameras.bin": cameras, "sparse/images.bin": images, "sparse/points3D.bin": struct.pack("<Q", 0)}
    found["colmap"] = binary, "sparse"
    text = {"sparse/cameras.txt": b"1 PINHOLE 64 48 60 60 32 24\n", "sparse/points3D.txt": b""}
    found["colmap.txt"] = text | {"sparse/images.txt": b"1 1 0 0 0 0 0 5 1 a.png\n\n"}, "sparse"
    return found


def _others(folder):
    from textured_quads import packed, textured, write_square

    from relight.transfer.store import Cache

    objects = [
        {"splat": "a.ply", "position": [1, 0, 0], "rotation_deg": 30, "scale": 0.5, "up": "+y"},
        {"splat": "a.ply"},
    ]
    found = {"layout": ({"l.json": json.dumps({"objects": objects}).encode(), "a.ply": b"ply"}, "l.json")}
    np.save(folder / "albedo.npy", np.full((12, 3), 0.5, np.float32))
    found["albedo"] = {"a.npy": (folder / "albedo.npy").read_bytes()}, "a.npy"
    (folder / "cache").mkdir()
    Cache(folder / "cache", "geometry").put("transfer", "raytraced", 3, 8, 0, transfer=np.zeros((12, 9), np.float32))
    kept = next((folder / "cache").glob("*.npz"))
    pixels = np.full((16, 16, 4), 255, np.uint8)
    pixels[:, 8:, 3] = 0
    moved = {"extensions": {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [1.5, 0.5]}}}
    copies = {"TRANSLATION": np.zeros((3, 3)), "ROTATION": np.tile([0, 0, 0, 1.0], (3, 1))}
    textures = [{"extensions": {"EXT_texture_webp": {"source": 0}}}]
    material = textured(moved, alphaMode="MASK")
    path = write_square(folder / "square.glb", material, [packed(pixels, "WEBP")], textures, copies)
    found["object"] = {"a.glb": path.read_bytes()}, "a.glb"
    found["cache"] = {f"cache/{kept.name}": kept.read_bytes()}, "cache"
    return found
