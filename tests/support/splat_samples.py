"""What the tests of splats and of their files share: random splats, an SH oracle, quantisation, a far background."""

from dataclasses import fields, replace

import numpy as np
from scipy.special import sph_harm_y

from splat2mesh.splats.splats import SH_C0, Splats


def make_splats(n, degree, seed=0):
    rng = np.random.default_rng(seed)
    return Splats(
        means=rng.normal(size=(n, 3)),
        scales=np.exp(rng.normal(-3, 1, (n, 3))),
        quats_wxyz=rng.normal(size=(n, 4)),
        opacities=rng.uniform(0.1, 0.9, n),
        sh=rng.normal(size=(n, (degree + 1) ** 2, 3)),
    )


def tile_at(x, splats):
    """The splats as a tile at another place."""
    return replace(splats, means=splats.means + np.array([x, 0, 0], np.float32))


def basis_oracle(directions, degree):
    """SciPy's complex harmonics made real and all-positive, then given the signs (-1)^m of 3DGS."""
    x, y, z = np.asarray(directions, float).T
    theta, phi = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    columns = []
    for band in range(degree + 1):
        for m in range(-band, band + 1):
            value = sph_harm_y(band, abs(m), theta, phi)
            part = value.real if m >= 0 else value.imag
            positive = part * (np.sqrt(2) * (-1) ** m if m else 1)
            columns.append(positive * (-1) ** m)
    return np.stack(columns, axis=-1)


def unit_vectors(n, seed=0):
    v = np.random.default_rng(seed).normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def assert_same(found, expected):
    for field in fields(expected):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name), field.name)


def store(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    return path


def quantized(values, low, high, bits):
    return np.rint((values - low) / (high - low) * ((1 << bits) - 1)).astype(np.uint32)


def smallest_three(quats):
    """Index of the largest component and the other three, sign-flipped so that the largest is positive."""
    largest = np.abs(quats).argmax(axis=1)
    positive = quats * np.sign(np.take_along_axis(quats, largest[:, None], 1))
    others = np.array([[c for c in range(4) if c != i] for i in largest])
    return largest, np.take_along_axis(positive, others, 1)


def open_air():
    """Near splats, far lawn, hedge, bricks and a white sky behind: Splats y up, far rows, those of the sky."""
    rng = np.random.default_rng(1)

    def ring(count, distance, low, high, color):
        turn, height = rng.uniform(0, 2 * np.pi, count), np.radians(rng.uniform(low, high, count))
        at = np.stack([np.cos(height) * np.cos(turn), np.sin(height), np.cos(height) * np.sin(turn)], axis=1)
        return distance * rng.uniform(0.95, 1.05, (count, 1)) * at, np.tile(color, (count, 1))

    parts = [
        (rng.uniform(-1, 1, (200, 3)), np.full((200, 3), 0.5)),
        ring(300, 20.0, -12, -4, [0.45, 0.6, 0.3]),
        ring(300, 30.0, -2, 6, [0.15, 0.25, 0.12]),
        ring(100, 15.0, 4, 12, [0.7, 0.5, 0.4]),
        ring(900, 90.0, 7, 60, [0.95, 0.97, 1.0]),
    ]
    means, colors = (np.concatenate(each) for each in zip(*parts, strict=True))
    count = len(means)
    sh = ((colors - 0.5) / SH_C0)[:, None].astype(np.float32)
    scales = 0.02 * np.maximum(np.linalg.norm(means, axis=1, keepdims=True), 1.0) * np.ones((1, 3))
    splats = Splats(means, scales, np.tile([1.0, 0, 0, 0], (count, 1)), np.full(count, 0.7), sh)
    return splats, np.arange(200, count), np.arange(count - 900, count)
