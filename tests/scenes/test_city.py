"""Generated cities: blocks that know only their place, and as many splats as were asked for."""

import json

import numpy as np

from scenes.__main__ import main
from scenes.city import BLOCK_M, block, blocks_across, ground_height
from splat2mesh.splats.formats import read_splats


def test_a_block_depends_on_its_place_and_the_seed_alone():
    np.testing.assert_array_equal(block(3, 1, 2).vertices, block(3, 1, 2).vertices)
    assert len(block(3, 1, 2).vertices) != len(block(4, 1, 2).vertices) or np.any(
        block(3, 1, 2).vertices != block(4, 1, 2).vertices
    )


def test_neighbours_meet_on_the_ground():
    def border(truth, x):
        ground = truth.vertices[truth.part == 0]
        found = ground[np.abs(ground[:, 0] - x) < 1e-3]
        return found[np.argsort(found[:, 2])]

    left, right = border(block(0, 0, 0), BLOCK_M), border(block(0, 1, 0), BLOCK_M)
    np.testing.assert_allclose(left, right, atol=1e-5)
    np.testing.assert_allclose(left[:, 1], ground_height(left[:, [0, 2]]), atol=1e-5)


def test_a_city_of_any_size_is_written_in_tiles(tmp_path, capsys):
    assert blocks_across(30e6) == 35 and blocks_across(100) == 2
    assert main([str(tmp_path / "city"), "--kind", "city", "--splats", "1.001e3", "--quiet"]) == 0
    files = sorted((tmp_path / "city" / "tiles").iterdir())
    counts = [len(read_splats(file)) for file in files]
    assert len(files) == 4 and sum(counts) == 1001 and max(counts) - min(counts) == 1
    facts = json.loads((tmp_path / "city" / "truth.json").read_text())
    assert facts["splats"] == 1001 and facts["blocks"] == 4
    for file, (x, z) in zip(files, ((0, 0), (0, 1), (1, 0), (1, 1)), strict=True):
        means = read_splats(file).means
        middle = np.median(means[:, 0]), -np.median(means[:, 2])
        np.testing.assert_allclose(middle, (np.array([x, z]) + 0.5) * BLOCK_M, atol=8.0)
