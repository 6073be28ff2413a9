"""The glossy table: closed forms for the lobe, what harmonics hold of it, its files."""

import json

import numpy as np
import pytest

from relight import Environment
from scenes import capture_views, seen_faces
from scenes.__main__ import main
from scenes.cameras import FLIP
from scenes.ceramics import ceramics
from scenes.highlights import glossy_splats, lobe_sample, mirrored_radiance
from splat2mesh.base.errors import InputError
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.splats.formats import read_splats

WHITE = Environment(np.ones((16, 32, 3), np.float32), "white")


@pytest.fixture(scope="module")
def truth():
    return ceramics(5, 3000)


def samples(alpha, cosine, count=40_000, reflectance=1.0):
    """Directions and weights of a lobe about +y, for an eye in the xy plane."""
    rng = np.random.default_rng(0)
    toward = np.tile([np.sqrt(1 - cosine**2), cosine, 0.0], (count, 1))
    normals = np.tile([0.0, 1.0, 0.0], (count, 1))
    return lobe_sample(
        np.full(count, alpha), normals, toward, *rng.random((2, count)), np.full((count, 3), reflectance)
    )


def test_a_furnace_gives_what_one_scattering_leaves():
    # At alpha 1 and normal incidence half vectors are cosine-weighted. Half of the light is above the
    # surface, its cosine c even in (0, 1), its weight 2 c / (1 + c): 1 - ln 2.
    assert samples(1.0, 1.0)[1].mean() == pytest.approx(1 - np.log(2), abs=0.005)
    for cosine in (0.3, 1.0):
        assert samples(0.05, cosine)[1].mean() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("cosine", [0.3, 0.7, 1.0])
def test_a_sharp_lobe_looks_where_a_mirror_does(cosine):
    directions, weight = samples(0.02, cosine)
    mean = (directions * weight).sum(axis=0)
    mirror = np.array([-np.sqrt(1 - cosine**2), cosine, 0.0])
    assert np.degrees(np.arccos(mean @ mirror / np.linalg.norm(mean))) < 0.5


@pytest.mark.parametrize("alpha", [0.1, 0.3])
def test_the_lobe_is_that_of_its_density(alpha):
    # One integral two ways: samples of visible normals, and D G2 / (4 cos) summed over the hemisphere.
    cosine, light = 0.8, np.array([-0.5, 0.7, 0.3])
    directions, weight = samples(alpha, cosine, 200_000)
    found = (weight[:, 0] * np.exp(8 * (directions @ light - 1))).mean()
    rng = np.random.default_rng(1)
    ways = rng.normal(size=(2_000_000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ways[:, 1] = np.abs(ways[:, 1])
    toward = np.array([np.sqrt(1 - cosine**2), cosine, 0.0])
    half = ways + toward
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    density = alpha**2 / (np.pi * (half[:, 1] ** 2 * (alpha**2 - 1) + 1) ** 2)

    def smith(up):
        return (np.sqrt(1 + alpha**2 * (1 / up**2 - 1)) - 1) / 2

    masking = 1 / (1 + smith(cosine) + smith(ways[:, 1]))
    expected = 2 * np.pi * (density * masking / (4 * cosine) * np.exp(8 * (ways @ light - 1))).mean()
    assert found == pytest.approx(expected, rel=0.02)


def test_reflectance_is_schlicks():
    for cosine in (0.2, 0.5, 1.0):
        ratio = samples(0.02, cosine, reflectance=0.04)[1].sum() / samples(0.02, cosine)[1].sum()
        assert ratio == pytest.approx(0.04 + 0.96 * (1 - cosine) ** 5, rel=0.05)


def test_what_lies_in_the_mirror_is_seen(truth):
    # The top of the table as a metal would mirror what stands on it, and nothing else where the sky is black.
    caster = RayCaster(truth.vertices, truth.faces)
    rows = np.flatnonzero(truth.metal[truth.faces[:, 0]])
    face = truth.faces[rows]
    points, normals = truth.vertices[face].mean(axis=1), truth.normals[face].mean(axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    asked = truth, caster, points, normals, face, np.full((len(rows), 3), 1 / 3), normals
    ones, nothing = np.ones_like(truth.vertices), np.zeros_like(truth.vertices)
    black = Environment(np.zeros((2, 4, 3), np.float32), "black")
    own = truth.reflectance[face].mean(axis=1)
    sky, scene, both = mirrored_radiance(*asked, [nothing, ones, ones], [WHITE, black, WHITE])
    np.testing.assert_allclose(sky + scene, both, rtol=1e-9)
    assert (sky <= own * 1.001).all() and scene.max() > 0.1 * own.max()


def test_the_seed_changes_everything_but_the_list_of_things(truth):
    again, other = ceramics(5, 3000), ceramics(6, 3000)
    for name in ("vertices", "albedo_linear", "reflectance", "alpha", "metal"):
        np.testing.assert_array_equal(getattr(again, name), getattr(truth, name))
    assert not set(np.unique(other.alpha)) & set(np.unique(truth.alpha)) - {1.0}
    for each in (truth, other):
        of_part = [each.part == part for part in range(8)]
        assert [bool(each.glossy[rows].all()) for rows in of_part] == [
            False,
            True,
            True,
            True,
            True,
            True,
            False,
            False,
        ]
        assert [bool(each.metal[rows].any()) for rows in of_part] == [False] * 4 + [True, True, False, False]
        assert not each.albedo_linear[each.metal].any() and each.albedo_linear[~each.metal].min() > 0.02


def test_without_gloss_metals_are_painted(truth):
    matte = ceramics(5, 3000, glossy=False)
    np.testing.assert_array_equal(matte.vertices, truth.vertices)
    np.testing.assert_array_equal(matte.albedo_linear[~truth.metal], truth.albedo_linear[~truth.metal])
    assert not matte.glossy.any() and matte.albedo_linear[truth.metal].min() > 0.02


def test_only_what_is_glossy_depends_on_the_view(truth):
    views = capture_views(truth, 32)
    seen = seen_faces(truth, views)
    lights = [Environment.load("studio"), Environment.load("noon")]
    (first, second), (factor, _) = glossy_splats(truth, lights, views, 1500, 1, seen)
    again, _ = glossy_splats(truth, lights[:1], views, 1500, 1, seen)
    np.testing.assert_array_equal(again[0].sh, first.sh)
    np.testing.assert_array_equal(first.means, second.means)
    matte = ceramics(5, 3000, glossy=False)
    (plain,), (same,) = glossy_splats(matte, lights[:1], views, 1500, 1, seen)
    assert factor == pytest.approx(same, rel=0.1)
    # What differs is the gloss, and it is that of the glossy things.
    difference = np.abs(first.sh - plain.sh)[:, 1:].mean(axis=(1, 2))
    near = np.argmin(np.linalg.norm(truth.vertices[None] - (first.means * FLIP)[:, None], axis=2), axis=1)
    assert np.median(difference[truth.glossy[near]]) > 20 * np.median(difference[~truth.glossy[near]])


def test_the_folder_holds_the_truth(tmp_path, capsys):
    out = tmp_path / "table"
    wanted = [
        str(out),
        "--kind",
        "ceramics",
        "--splats",
        "800",
        "--vertices",
        "2000",
        "--views",
        "12",
        "--env",
        "studio",
    ]
    assert main([*wanted, "--relit", "noon"]) == 0
    facts = json.loads((out / "truth.json").read_text())
    assert facts["glossy"] and list(facts["lights"]) == ["noon"]
    splats, relit = read_splats(out / "splat.ply"), read_splats(out / "truth_noon.ply")
    assert splats.degree == 3 and len(splats) == 800
    np.testing.assert_array_equal(splats.means, relit.means)
    gloss = np.load(out / "truth_gloss.npz")
    assert gloss["alpha"].shape == (facts["vertices"],) and gloss["metal"].any()
    assert main([*wanted, "--overwrite", "--matte"]) == 0
    assert not json.loads((out / "truth.json").read_text())["glossy"]
    assert main([str(tmp_path / "other"), "--matte"]) == 2 and "--matte is for ceramics" in capsys.readouterr().err


def test_too_few_vertices_are_refused():
    with pytest.raises(InputError, match="expected at least 1000"):
        ceramics(0, 10)
