"""`.ksplat` files and LCC scenes, written here number by number: no library writes them."""

import json
import struct

import numpy as np

from splat2mesh.splats.splats import SH_C0


def _bytes(values, low=0.0, high=1.0):
    return np.clip(np.rint((values - low) / (high - low) * 255), 0, 255).astype("u1")


def ksplat_bytes(splats, level, bucket=256, block=5.0, bounds=(-2.0, 2.0), sections=1):
    """The file, each section a share of the splats in buckets of successive rows, the last one not filled."""
    header = bytearray(4096)
    header[0:2] = 0, 1
    struct.pack_into("<IIIIH", header, 4, sections, sections, len(splats), len(splats), level)
    struct.pack_into("<ff", header, 36, *bounds)
    heads, bodies = [], []
    for rows in np.array_split(np.arange(len(splats)), sections):
        head, body = _section(splats.take(rows), level, bucket, block, bounds)
        heads.append(head)
        bodies.append(body)
    return bytes(header) + b"".join(heads) + b"".join(bodies)


def _section(splats, level, bucket, block, bounds):
    n, degree = len(splats), splats.degree
    full, left = divmod(n, bucket)
    buckets = full + (left > 0)
    centers = np.array([splats.means[i * bucket : (i + 1) * bucket].mean(axis=0) for i in range(buckets)], "<f4")
    rest = splats.sh[:, 1:]
    bands = [rest[:, d * d - 1 : (d + 1) ** 2 - 1].swapaxes(1, 2).reshape(n, -1) for d in range(1, degree + 1)]
    harmonics = np.hstack(bands) if bands else np.zeros((n, 0))
    rgba = _bytes(np.column_stack([SH_C0 * splats.sh[:, 0] + 0.5, splats.opacities]))
    if level == 0:
        parts = [splats.means.astype("<f4"), splats.scales.astype("<f4"), splats.quats_wxyz.astype("<f4")]
        parts += [rgba, harmonics.astype("<f4")]
    else:
        apart = splats.means - np.repeat(centers, bucket, axis=0)[:n]
        fixed = np.rint(apart / (block / 2 / 32767) + 32767)
        parts = [fixed.astype("<u2"), splats.scales.astype("<f2"), splats.quats_wxyz.astype("<f2"), rgba]
        parts.append(harmonics.astype("<f2") if level == 1 else _bytes(harmonics, *bounds))
    packed = np.hstack([np.ascontiguousarray(part).view("u1").reshape(n, -1) for part in parts])
    sizes, stored = np.array([left] if left else [], "<u4"), 12 if level else 0
    kept = centers.tobytes() if level else b""
    head = bytearray(1024)
    counts = n, n, bucket, buckets
    struct.pack_into(
        "<IIIIfHxxIIIIH", head, 0, *counts, block, stored, 32767 if level else 1, 0, full, len(sizes), degree
    )
    return bytes(head), sizes.tobytes() + kept + packed.tobytes()


def write_lcc(folder, levels, far=None, units=3):
    """A scene whose levels of detail are these splats, each dealt out to units, in the frame of the file, z up."""
    folder.mkdir(parents=True, exist_ok=True)
    everything = [*levels, *([far] if far is not None else [])]
    has_rest = bool(levels[0].degree)
    low, high = (pick([pick(each.scales) for each in everything]) for pick in (np.min, np.max))
    attributes = [{"name": "scale", "min": [float(low)] * 3, "max": [float(high)] * 3}]
    if has_rest:
        attributes.append({"name": "shcoef", "min": [-1.0, -2.0, -3.0], "max": [3.0, 2.0, 1.0]})
    bounds = (low, high), np.array([[-1.0, -2.0, -3.0], [3.0, 2.0, 1.0]])
    meta = {"totalLevel": len(levels), "splats": [len(each) for each in levels], "attributes": attributes}
    meta |= {"version": "4.0", "fileType": "Quality" if has_rest else "Portable"}
    data, rest, index = b"", b"", [struct.pack("<hh", number, 0) for number in range(units)]
    for splats in levels:
        for number, rows in enumerate(np.array_split(np.arange(len(splats)), units)):
            near, more = _lcc_rows(splats.take(rows), *bounds)
            index[number] += struct.pack("<iqi", len(rows), len(data), len(near) * 32)
            data += near.tobytes()
            rest += more.tobytes()
    (folder / "meta.lcc").write_text(json.dumps(meta))
    (folder / "index.bin").write_bytes(b"".join(index))
    (folder / "data.bin").write_bytes(data)
    if has_rest:
        (folder / "shcoef.bin").write_bytes(rest)
    if far is not None:
        near, more = _lcc_rows(far, *bounds)
        wide = np.hstack([near.view("u1").reshape(len(far), -1), more.view("u1").reshape(len(far), -1)])
        (folder / "environment.bin").write_bytes(wide.tobytes() if has_rest else near.tobytes())
    return folder / "meta.lcc"


def _lcc_rows(splats, scales, bounds):
    n = len(splats)
    fields = [("mean", "<f4", 3), ("rgba", "u1", 4), ("scale", "<u2", 3), ("low", "<u2"), ("high", "<u2")]
    rows = np.zeros(n, [*fields, ("normal", "<u2", 3)])
    rows["mean"] = splats.means
    rows["rgba"] = _bytes(np.column_stack([SH_C0 * splats.sh[:, 0] + 0.5, splats.opacities]))
    rows["scale"] = np.rint((splats.scales - scales[0]) / (scales[1] - scales[0]) * 65535)
    quats = splats.quats_wxyz[:, [1, 2, 3, 0]].astype(np.float64)
    largest = np.abs(quats).argmax(axis=1)
    quats *= np.sign(np.take_along_axis(quats, largest[:, None], 1))
    packed = largest.astype(np.uint32) << 30
    for row in range(n):
        for place, value in enumerate(np.delete(quats[row], largest[row])):
            packed[row] |= np.uint32(np.rint((value * np.sqrt(2) + 1) / 2 * 1023)) << np.uint32(10 * place)
    rows["low"], rows["high"] = packed & 0xFFFF, packed >> 16
    rest = np.zeros((n, 16), "<u4")
    if splats.degree:
        shares = np.clip((splats.sh[:, 1:] - bounds[0]) / (bounds[1] - bounds[0]), 0, 1)
        for channel, (bits, shift) in enumerate(((11, 0), (10, 11), (11, 21))):
            rest[:, :15] |= np.rint(shares[..., channel] * ((1 << bits) - 1)).astype(np.uint32) << np.uint32(shift)
    return rows, rest
