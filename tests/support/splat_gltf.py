"""glTF files of splats, built from their JSON and bytes alone."""

import json
import struct

import numpy as np

NAME = "KHR_gaussian_splatting"
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
_CODES = {"f4": 5126, "i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123}


def glb_bytes(document, blob):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob = blob + bytes(-len(blob) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def attributes_of(splats):
    """Name -> array, as the extension has them."""
    found = {"POSITION": splats.means, f"{NAME}:ROTATION": splats.quats_wxyz[:, [1, 2, 3, 0]]}
    found |= {f"{NAME}:SCALE": splats.scales, f"{NAME}:OPACITY": splats.opacities}
    for degree in range(splats.degree + 1):
        for order in range(2 * degree + 1):
            found[f"{NAME}:SH_DEGREE_{degree}_COEF_{order}"] = splats.sh[:, degree * degree + order]
    return found


def splat_glb(attributes, nodes=None, extension=None, meshes=()):
    """attributes: name -> array; integers are normalised. nodes: default one. meshes: further ones."""
    blob, views, accessors, names = b"", [], [], {}
    for name, array in attributes.items():
        array = np.ascontiguousarray(array, array.dtype if array.dtype.kind in "iu" else np.float32)
        width = 1 if array.ndim == 1 else array.shape[1]
        blob += bytes(-len(blob) % 4)
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes})
        accessor = {"bufferView": len(views) - 1, "componentType": _CODES[array.dtype.str[1:]], "count": len(array)}
        accessor |= {"type": _TYPES[width]} | ({"normalized": True} if array.dtype.kind in "iu" else {})
        accessors.append(accessor)
        names[name] = len(accessors) - 1
        blob += array.tobytes()
    look = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"} | (extension or {})
    primitive = {"mode": 0, "attributes": names, "extensions": {NAME: look}}
    nodes = nodes or [{"mesh": 0}]
    document = {"asset": {"version": "2.0"}, "extensionsUsed": [NAME], "extensionsRequired": [NAME]}
    document |= {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes}
    document |= {"meshes": [{"primitives": [primitive]}, *meshes], "accessors": accessors, "bufferViews": views}
    return glb_bytes(document | {"buffers": [{"byteLength": len(blob)}]}, blob)


def spz_glb(spz, name=f"{NAME}_compression_spz_2", inside=True):
    """A file that holds an SPZ. inside: whether the extension stands in that of the splats, or beside it."""
    packed = {name: {"bufferView": 0}}
    extensions = {NAME: {"extensions": packed}} if inside else packed
    document = {"asset": {"version": "2.0"}, "extensionsUsed": [name], "extensionsRequired": [name]}
    document |= {"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    document |= {"meshes": [{"primitives": [{"mode": 0, "attributes": {}, "extensions": extensions}]}]}
    document |= {"buffers": [{"byteLength": len(spz)}], "bufferViews": [{"buffer": 0, "byteLength": len(spz)}]}
    return glb_bytes(document, spz)
