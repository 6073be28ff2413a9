"""A reader of the bundle of live light, as docs/live.md specifies it, for authors of loaders.

Shadows and the sun in leaves are left to the caller.
"""

import hashlib
import json
import pathlib

import numpy as np


def read(folder, splat="splat.ply"):
    folder = pathlib.Path(folder)
    meta = json.loads((folder / "live.json").read_text())
    if meta["format"] != "relight-live" or meta["version"] > 2:
        raise ValueError(f"{folder}: not a bundle of version 1 or 2")
    (entry,) = (each for each in meta["splats"] if each["file"] == splat)
    if hashlib.sha256((folder / splat).read_bytes()).hexdigest() != entry["sha256"] or entry["count"] != meta["count"]:
        raise ValueError(f"{splat} is not the splat of this bundle (its SHA-256 or count differs): export it again")
    names = "weights", "clusters", "directions", "direct", "spread", "lamps"
    n, (w, c, d, *k) = meta["count"], (meta["basis"][name] for name in names)
    rows = np.fromfile(folder / "transfer.bin", np.uint8).reshape(n, 2 + w)
    with open(folder / "basis.bin", "rb") as file:
        sizes = np.fromfile(file, "<f4", 1 + d)
        directions = np.fromfile(file, "<i2", (1 + d) * sum(k) * 3).reshape(1 + d, sum(k), 3) * sizes[:, None, None]
        scales = np.fromfile(file, "<f4", c * (1 + w)).reshape(c, 1 + w, 1)
        means = np.fromfile(file, "<i2", c * d).reshape(c, 1, d)
        parts = np.fromfile(file, "i1", c * w * d).reshape(c, w, d)
    basis = directions, np.concatenate([means, parts], axis=1) * scales
    surface = np.fromfile(folder / "surface.bin", np.uint8).reshape(n, 8)
    terms, data = [], (folder / "terms.bin").read_bytes() if meta.get("terms") else b""
    for term in meta.get("terms", []):
        values = np.ones((n, 3))
        if term["runs"] is not None:
            size = 8 * term["runs"]
            first, count = np.frombuffer(data[:size], "<u4").reshape(-1, 2).T.astype(int)
            stored = np.frombuffer(data[size : size + 3 * term["rows"]], np.uint8).reshape(-1, 3)
            data = data[size + 3 * term["rows"] :]
            values[:] = 0.0
            shining = np.where(stored > 0, term["peak"] * 2.0 ** ((stored - 255.0) / term["steps"]), 0.0)
            values[[i for a, b in zip(first, count, strict=True) for i in range(a, a + b)]] = shining
        terms.append(values)
    return meta, rows[:, :2].copy().view("<u2")[:, 0], rows[:, 2:].view(np.int8), basis, surface, terms


def turned(coefficients, angle):
    c = np.array(coefficients)
    degree = np.sqrt(np.arange(len(c))).astype(int)
    m = np.arange(len(c)) - degree * (degree + 1)
    return np.cos(m * angle)[:, None] * c - np.sin(m * angle)[:, None] * c[np.arange(len(c)) - 2 * m]


def table(bundle, light, angle=0.0):
    directions, parts = bundle[3]
    vector = np.concatenate([turned(light["rest"], angle), turned(light["whole"], angle)]) * light["exposure"]
    colors = np.einsum("dkx,kx->dx", directions, np.concatenate([vector, np.full((1, 3), light["lamps"])]))
    result = np.einsum("cwd,dx->cwx", parts, colors[1:])
    result[:, 0] += colors[0]
    return result


def change(bundle, light, angle=0.0, strengths=None):
    meta, cluster, weights, *_, terms = bundle
    rows = table(bundle, light, angle)[cluster]
    found = rows[:, 0] + np.einsum("nw,nwx->nx", weights, rows[:, 1:])
    strengths = [light.get("captured", 0.0)] + [1.0] * len(terms) if strengths is None else strengths
    for term, values, strength in zip(meta.get("terms", []), terms, strengths, strict=False):
        found = found + light["unit"] * strength * np.array(term["color"]) * values
    return found
