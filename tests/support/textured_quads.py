"""GLB files of a square with one material, written out by hand, and its pictures packed in several kinds."""

import io
import json

import numpy as np
from attack_samples import _Blob, _glb
from PIL import Image

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], np.float32)
"""Of the square, in the plane y = 0; its texture coordinates are x and z."""

FOUR = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], np.uint8)
"""Red, green; blue, yellow: from the top row."""


def packed(pixels, kind="PNG"):
    """The bytes of a picture, without loss."""
    found = io.BytesIO()
    Image.fromarray(pixels).save(found, kind, **({"lossless": True} if kind == "WEBP" else {}))
    return found.getvalue()


def write_square(path, material, pictures=(), textures=(), copies=None, uv=None, **more):
    """Write a GLB. pictures: bytes of each. textures, material: as JSON. copies: arrays of EXT_mesh_gpu_instancing by
    name. uv: (4, 2) of TEXCOORD_1."""
    blob = _Blob()
    attributes = {"POSITION": blob.add(CORNERS, 5126, "VEC3")}
    attributes["NORMAL"] = blob.add(np.tile(np.float32([0, 1, 0]), (4, 1)), 5126, "VEC3")
    attributes["TEXCOORD_0"] = blob.add(np.ascontiguousarray(CORNERS[:, ::2]), 5126, "VEC2")
    if uv is not None:
        attributes["TEXCOORD_1"] = blob.add(np.float32(uv), 5126, "VEC2")
    indices = blob.add(np.array([0, 2, 1, 0, 3, 2], "<u2"), 5123, "SCALAR")
    node = {"mesh": 0}
    if copies is not None:
        types = {2: "VEC2", 3: "VEC3", 4: "VEC4"}
        placed = {name: blob.add(np.float32(each), 5126, types[each.shape[1]]) for name, each in copies.items()}
        node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": placed}}
    images = []
    for content in pictures:
        images.append({"bufferView": len(blob.views)})
        blob.add(np.frombuffer(content, np.uint8), 5121, "SCALAR")
    primitive = {"attributes": attributes, "indices": indices, "material": 0}
    document = blob.document(meshes=[{"primitives": [primitive]}], nodes=[node], materials=[material], **more)
    document |= {"images": images, "textures": list(textures)} if images else {}
    path.write_bytes(_glb(json.loads(json.dumps(document)), blob.data))
    return path


def textured(info=None, **more):
    """A material that shows its first texture."""
    return {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **(info or {})}}, **more}
