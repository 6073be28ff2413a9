"""One direct light for a geometry at rest and one that moves."""

import numpy as np
import open3d as o3d
import pytest

from relight import Environment
from relight.engine.direct import DirectLight
from relight.engine.dynamic import DynamicGeometry
from relight.engine.static import StaticGeometry
from relight.light.sun_split import split
from relight.transfer.precomputed import Precomputed
from relight.transfer.settings import Settings
from relight.transfer.store import Cache
from relight.transfer.sunlight import sunlight
from splat2mesh.base.progress import Stages
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

SUNLIT = Settings("raytraced", 4, 32, 0.01)


@pytest.fixture(scope="module")
def scene():
    torus = o3d.geometry.TriangleMesh.create_torus(1.0, 0.4, 40, 60)
    torus.compute_vertex_normals()
    arrays = np.asarray(torus.vertices, np.float32), np.asarray(torus.vertex_normals, np.float32)
    return Scene([Mesh(*arrays, np.asarray(torus.triangles, np.int32), np.full(arrays[0].shape, 128, np.uint8))])


@pytest.fixture(scope="module")
def precomputed(scene):
    return Precomputed(scene, 0)


def lit(geometry):
    return DirectLight(geometry, Cache(), Stages())


@pytest.mark.parametrize("tolerance", [0.0, 0.01])
def test_a_scene_at_rest_is_to_the_bit_a_moving_one_of_one_body(scene, precomputed, tolerance):
    settings = SUNLIT._replace(sun_tolerance=tolerance)
    static = lit(StaticGeometry(precomputed, Stages()))
    dynamic = lit(DynamicGeometry(scene, [], settings, 0))
    for environment in (Environment.load("noon"), Environment.load("sunset").rotated(30.0), Environment.load("noon")):
        (expected, suns, done), (found, same_suns, as_done) = (
            each.shade(environment, settings) for each in (static, dynamic)
        )
        np.testing.assert_array_equal(found, expected)
        assert suns == same_suns and (suns > 0) == (tolerance > 0.0) and done == as_done == settings


def test_it_is_the_product_of_transfer_and_rest_and_the_suns(precomputed):
    noon = Environment.load("noon")
    rest, suns = split(noon, tolerance=0.01)
    transfer = precomputed.transfer(SUNLIT)[0][:, :16].astype(np.float64)
    expected = np.maximum(transfer @ rest.sh(4) + sunlight(precomputed.occluder, slice(None), suns), 0.0)
    found, count, _ = lit(StaticGeometry(precomputed, Stages())).shade(noon, SUNLIT)
    np.testing.assert_allclose(found, expected, atol=2e-6 * expected.max())
    assert count == len(suns) > 0
