"""How thick space is: kept in bytes, read back, made for scenes with leaves and for no others."""

import numpy as np
import pytest

from splat2mesh.base.errors import InputError
from splat2mesh.scene.measured import Measured
from splat2mesh.scene.optical_depth import MOST, OpticalDepth
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.measure import measured_of


def made():
    random = np.random.default_rng(0)
    levels = [random.exponential(0.5, (3, 4, 5)), random.exponential(2.0, (2, 3, 4))]
    return OpticalDepth.of_levels([[0, 0, 0], [-1, -1, -1]], [0.1, 0.2], levels), levels


def test_it_reads_back_bit_by_bit(tmp_path):
    depth, _ = made()
    zeros = np.zeros(7, np.float32)
    Measured(None, zeros, zeros, depth).save(tmp_path / "m.npz")
    found = Measured.load(tmp_path / "m.npz", 7).depth
    for name in OpticalDepth._fields:
        assert np.array_equal(getattr(found, name), getattr(depth, name)), name


def test_rounding_is_a_256th_of_the_square_root_and_most_is_opaque():
    depth, levels = made()
    given = np.concatenate([level.ravel() for level in levels])
    step = np.abs(np.sqrt(depth.depth / MOST) - np.sqrt(np.minimum(given, MOST) / MOST))
    assert step.max() <= 0.5 / 255 + 1e-6 and depth.depth.max() <= MOST
    assert depth.starts.tolist() == [0, 60] and depth.shapes.tolist() == [[3, 4, 5], [2, 3, 4]]


def test_parts_that_do_not_fit_are_refused(tmp_path):
    depth, _ = made()
    zeros = np.zeros(7, np.float32)
    Measured(None, zeros, zeros, depth._replace(depth=depth.depth[:-1])).save(tmp_path / "m.npz")
    with pytest.raises(InputError, match=r"m\.npz: damaged \(the parts of its optical depth differ"):
        Measured.load(tmp_path / "m.npz", 7)


def splats(kind, count=3000):
    """A bush of Gaussians that face every way, or a flat wall."""
    random = np.random.default_rng(1)
    if kind == "bush":
        means, quats = random.normal(size=(count, 3)), random.normal(size=(count, 4))
    else:
        means, quats = random.uniform(-1, 1, (count, 3)) * [1, 1, 0.001], np.tile([1.0, 0, 0, 0], (count, 1))
    return Splats(means, np.tile([0.05, 0.04, 0.002], (count, 1)), quats, np.full(count, 0.8), np.zeros((count, 1, 3)))


def test_only_what_has_leaves_has_a_grid():
    none = np.zeros(0, np.int64)
    bush = measured_of(splats("bush"), none, splats("bush").means[::10], np.eye(4))
    assert bush.vertex_volume.mean() > 0.8 and bush.depth is not None and bush.depth.depth.max() > 0.3
    assert measured_of(splats("wall"), none, splats("wall").means[::10], np.eye(4)).depth is None
