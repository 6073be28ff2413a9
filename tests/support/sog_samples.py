"""SOG files encoded here: their images and meta.json, both versions."""

import json
from dataclasses import replace

import imagecodecs
import numpy as np
from splat_samples import make_splats, smallest_three, store


def webp(values, size):
    """(N, 3 or 4) integers as a lossless image of `size` (H, W), the rest zero."""
    image = np.zeros((size[0] * size[1], 4), np.uint8)
    image[:, 3] = 255
    image[: len(values), : values.shape[1]] = values
    return imagecodecs.webp_encode(image.reshape(*size, 4), lossless=True)


def sog_parts(splats, version):
    """File name -> bytes of an unbundled SOG. Scales and colours are snapped to 256 even levels."""
    n, size = len(splats), (8, -(-len(splats) // 8))
    mean_log = np.sign(splats.means) * np.log1p(np.abs(splats.means))
    low, high = mean_log.min(axis=0), mean_log.max(axis=0)
    fixed = np.rint((mean_log - low) / (high - low) * 65535).astype(int)
    largest, small = smallest_three(splats.quats_wxyz)
    quats = np.rint((small * np.sqrt(2) + 1) * 127.5)
    scale_log, dc = np.log(splats.scales), splats.sh[:, 0]

    def levels(values):
        return np.rint((values - values.min()) / np.ptp(values) * 255)

    def description(values, channels, name):
        if version == 2:
            return {"codebook": np.linspace(values.min(), values.max(), 256).tolist(), "files": [name]}
        bounds = float(values.min()), float(values.max())
        spread = {"mins": [bounds[0]] * channels, "maxs": [bounds[1]] * channels}
        return (spread if channels > 1 else {"mins": bounds[0], "maxs": bounds[1]}) | {"files": [name]}

    means = {"mins": low.tolist(), "maxs": high.tolist(), "files": ["means_l.webp", "means_u.webp"]}
    meta = {"means": means, "quats": {"files": ["quats.webp"]}}
    meta |= {"scales": description(scale_log, 3, "scales.webp"), "sh0": description(dc, 3, "sh0.webp")}
    alpha = np.rint(splats.opacities * 255)
    if version == 2:
        meta |= {"version": 2, "count": n}
    else:
        means["shape"] = [n, 3]
        logits = np.log(splats.opacities / (1 - splats.opacities))
        alpha = levels(logits)
        meta["sh0"]["mins"].append(float(logits.min()))
        meta["sh0"]["maxs"].append(float(logits.max()))
    parts = {
        "means_l.webp": webp(fixed & 255, size),
        "means_u.webp": webp(fixed >> 8, size),
        "quats.webp": webp(np.column_stack([quats, 252 + largest]), size),
        "scales.webp": webp(levels(scale_log), size),
        "sh0.webp": webp(np.column_stack([levels(dc), alpha]), size),
    }
    if splats.degree:
        rest = splats.sh.shape[1] - 1
        palette, label = np.unique(splats.sh[:, 1:], axis=0, return_inverse=True)
        rows = -(-len(palette) // 64)
        image = levels(palette).reshape(-1, 3)  # 64 entries a row, each `rest` pixels wide
        meta["shN"] = description(palette, 1, "shN_centroids.webp")
        meta["shN"]["files"].append("shN_labels.webp")
        parts["shN_centroids.webp"] = webp(image, (rows, 64 * rest))
        parts["shN_labels.webp"] = webp(np.column_stack([label & 255, label >> 8, 0 * label]), size)
    return parts | {"meta.json": json.dumps(meta).encode()}


def store_folder(tmp_path, parts):
    for name, data in parts.items():
        store(tmp_path, name, data)
    return tmp_path


def palette_splats(n, degree):
    """Splats that share 100 sets of higher coefficients."""
    splats = make_splats(n, degree)
    return replace(splats, sh=np.concatenate([splats.sh[:, :1], splats.sh[np.arange(n) % 100, 1:]], axis=1))
