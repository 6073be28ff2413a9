"""What the tests of splats and of their files share: random splats, an SH oracle, quantisation."""

from dataclasses import fields

import numpy as np
from scipy.special import sph_harm_y

from splat2mesh.splats.splats import Splats


def make_splats(n, degree, seed=0):
    rng = np.random.default_rng(seed)
    return Splats(
        means=rng.normal(size=(n, 3)),
        scales=np.exp(rng.normal(-3, 1, (n, 3))),
        quats_wxyz=rng.normal(size=(n, 4)),
        opacities=rng.uniform(0.1, 0.9, n),
        sh=rng.normal(size=(n, (degree + 1) ** 2, 3)),
    )


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
