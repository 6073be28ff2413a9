"""3D Tiles: boxes hold their tiles with z up, and a coarse twin stands in for its tile from afar."""

import numpy as np
import pytest

from splat2mesh.tiles.tileset import FAR_ERROR, tileset

TILES = [
    {"name": "tiles/00000", "bounds": [[0.0, 1.0, 2.0], [4.0, 3.0, 8.0]]},
    {"name": "tiles/00001", "bounds": [[4.0, 0.0, 2.0], [6.0, 0.0, 8.0]]},
]


def corners(box):
    """Lowest and highest corner of a box of 12 numbers, y up."""
    center, half = np.array(box[:3]), np.abs(np.array(box[3:]).reshape(3, 3)).sum(axis=0)
    (x0, y0, z0), (x1, y1, z1) = center - half, center + half
    return np.array([[x0, z0, -y1], [x1, z1, -y0]])


def test_boxes_hold_exactly_what_they_are_of():
    document = tileset(TILES, 0.1, twins=False)
    for child, tile in zip(document["root"]["children"], TILES, strict=True):
        low, high = np.array(tile["bounds"])
        flat = np.array([0.0, 1e-3 * (high[1] == low[1]), 0.0])  # a flat tile gets some height, as boxes need
        np.testing.assert_allclose(corners(child["boundingVolume"]["box"]), [low - flat, high + flat], atol=1e-12)
        assert child["content"] == {"uri": f"{tile['name']}/mesh.glb"} and child["geometricError"] == 0.0
    np.testing.assert_allclose(corners(document["root"]["boundingVolume"]["box"]), [[0, 0, 2], [6, 3, 8]])
    assert document["asset"] == {"version": "1.1"} and document["root"]["refine"] == "ADD"
    assert document["geometricError"] == 2 * document["root"]["geometricError"] == pytest.approx(2 * np.sqrt(81))


def test_a_coarse_twin_is_replaced_by_its_tile_and_errs_more():
    document = tileset(TILES, 0.5, twins=True)
    for child, tile in zip(document["root"]["children"], TILES, strict=True):
        (leaf,) = child["children"]
        assert child["refine"] == "REPLACE" and child["content"]["uri"].endswith("/far.glb")
        assert leaf["content"]["uri"].endswith("/mesh.glb") and leaf["boundingVolume"] == child["boundingVolume"]
        low, high = np.array(tile["bounds"])
        expected = max(FAR_ERROR * np.linalg.norm(high - low), 1.0)
        assert child["geometricError"] == pytest.approx(expected) and child["geometricError"] > leaf["geometricError"]
