"""Primaries of colour spaces, and matrices to them from linear sRGB, written out once more."""

import numpy as np

PRIMARIES = {
    "Rec.709": (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329),
    "AP0": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767),
    "AP1": (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767),
    "Rec.2020": (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329),
    "XYZ": (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3),
    "P3": (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329),
}

CONES = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""Bradford's responses: Lam, "Metamerism and Colour Constancy" (1985), as in ICC.1 annex E."""


def to_xyz(chromaticities):
    """(3, 3) to CIE XYZ, and (3,) its white of luminance 1."""
    x, y = np.array(chromaticities).reshape(4, 2).T
    columns = np.stack([x, y, 1 - x - y])
    white = columns[:, 3] / y[3]
    return columns[:, :3] * np.linalg.solve(columns[:, :3], white), white


def expected_matrix(chromaticities):
    """(3, 3) from linear sRGB to a space, white to white."""
    (shared, white), (own, wanted) = to_xyz(PRIMARIES["Rec.709"]), to_xyz(chromaticities)
    adapted = np.linalg.solve(CONES, np.diag(CONES @ wanted / (CONES @ white)) @ CONES)
    return np.linalg.solve(own, adapted @ shared)
