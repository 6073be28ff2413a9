"""What lamps give by cosine-weighted rays: an oracle that shares nothing with closed forms and shadow rays."""

import numpy as np

RAYS = 200_000
"""The standard error of a share p of them is sqrt(p / RAYS): 2e-4 for .01."""


def seen_share(hits, normal, seed=0):
    """The share of cosine-weighted rays for which `hits(directions (N, 3))` is true: irradiance over pi."""
    rng = np.random.default_rng(seed)
    u, azimuth = rng.random(RAYS), 2 * np.pi * rng.random(RAYS)
    tangent = np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.9 else [0, 1.0, 0])
    tangent /= np.linalg.norm(tangent)
    local = np.stack([np.sqrt(u) * np.cos(azimuth), np.sqrt(u) * np.sin(azimuth), np.sqrt(1 - u)], axis=1)
    return hits(local @ np.stack([tangent, np.cross(normal, tangent), normal])).mean()


def share_error(share):
    """Five standard errors of a share."""
    return 5 * np.sqrt(max(share, 1e-4) / RAYS)


def hits_tube(lamp, place, free=lambda points: True):
    """Rays from a place outside a tube that meet its side, where `free(points (N, 3))` says that nothing covers it."""
    axis = np.subtract(lamp.end, lamp.start)
    length = np.linalg.norm(axis)
    axis = axis / length
    origin = np.subtract(place, lamp.start)
    off = origin - (origin @ axis) * axis

    def hits(directions):
        flat = directions - np.outer(directions @ axis, axis)
        a, b, c = (flat * flat).sum(axis=1), flat @ off, off @ off - lamp.radius**2
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (-b - np.sqrt(b * b - a * c)) / a  # not a number where it misses
        along = origin @ axis + t * (directions @ axis)
        return (t > 0) & (along > 0) & (along < length) & free(place + t[:, None] * directions)

    return hits
