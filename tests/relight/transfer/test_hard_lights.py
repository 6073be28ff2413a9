"""Hard cases of light transport: single pixels, suns, odd images, bounces without loss or gain, order and threads."""

import hashlib
import json
import os
import subprocess
import sys
import warnings
from itertools import pairwise

import numba
import numpy as np
import OpenEXR
import pytest
from hard_scenes import (
    EPS32,
    EVERYTHING,
    error,
    everything,
    joined,
    knobbed_torus,
    rough_light,
    scene,
    sheet,
    ten_bands,
)

from relight import Environment, cli
from relight.light.environment import turned_about_y
from relight.light.sun_split import split
from relight.sh import harmonics
from relight.transfer.bounces import Interreflection, with_bounces
from relight.transfer.occluder import Occluder
from relight.transfer.reference import reference
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene


@pytest.fixture(scope="module")
def lit():
    """A Relighter with every effect, and its twin without suns."""
    return [ten_bands(scene(*knobbed_torus()), rays=64, effects=chosen) for chosen in (EVERYTHING, ["shadows"])]


@pytest.fixture(scope="module")
def torus():
    vertices, normals, faces = knobbed_torus()
    return Occluder(np.float32(vertices), normals, faces)


def one_pixel(row, column, value=1e4, height=16, width=32):
    image = np.zeros((height, width, 3), np.float32)
    image[row, column] = value
    return Environment(image)


def mean_of(relighter, environment):
    """Radiance of a white scene with direct light alone."""
    return relighter.direct(environment, relighter._settings_now())[0]


# -- single pixels and suns


@pytest.mark.parametrize("row", [0, 5, 8, 15])
@pytest.mark.parametrize("column", [0, 31])
def test_pixels_at_poles_and_seam_shine_as_any_other_of_their_latitude(lit, row, column):
    before, turned = one_pixel(row, 13), one_pixel(row, column).rotated(360.0 / 32 * (column - 13))
    shining, banded = ([mean_of(relighter, light) for light in (before, turned)] for relighter in lit)
    assert banded[0].max() > 0
    assert np.abs(banded[1] - banded[0]).max() < 1e-6 * banded[0].max()
    # A texel of 11 degrees is some thirty suns, chosen by rounding where they are equally near: within the
    # tolerance of the split they may be others, with all the energy.
    assert error(shining[1], shining[0]) < 0.01
    weights = [split(light)[1].weights.sum(axis=0) for light in (before, turned)]
    np.testing.assert_allclose(weights[1], weights[0], rtol=1e-12)


@pytest.mark.parametrize("pixel", [(20, 30), (0, 5), (63, 100), (31, 0), (31, 127)])
def test_a_sun_of_a_billion_over_black_keeps_its_energy(lit, torus, pixel):
    light = one_pixel(*pixel, 1e9, 64, 128)
    expected = reference(torus, slice(None), light, 2048)
    found, banded = (mean_of(relighter, light) for relighter in lit)
    # Six to a dozen suns stand for a texel of 2.8 degrees: edges of shadows are the only difference.
    assert error(found, expected) < 0.003
    assert found.sum(dtype=float) == pytest.approx(expected.sum(dtype=float), rel=1e-3)
    assert error(banded, expected) < 0.3  # ten bands: broad shadows and rings
    for radiance in (found, banded, lit[0].shade(light, np.full(found.shape, 0.7))):
        assert np.isfinite(radiance).all() and (radiance >= 0).all() and radiance.max() > 1e4


def test_the_largest_half_floats_arrive(lit, torus, tmp_path):
    image = np.full((32, 64, 3), 0.25, np.float16)
    image[9, 20:22] = 65504.0
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": image}).write(str(tmp_path / "half.exr"))
    light = Environment.load(tmp_path / "half.exr")
    np.testing.assert_array_equal(light.radiance, image)
    assert light.repaired == {}
    assert error(mean_of(lit[0], light), reference(torus, slice(None), light)) < 0.01


# -- images


SHAPES = [(1, 1), (2, 1), (1, 2), (5, 7), (7, 5), (3, 1), (2, 4096), (1024, 2), (1024, 16)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("where", ["corner", "middle"])
def test_images_of_any_shape_light_as_their_patches_do(lit, torus, shape, where):
    texel = (0, 0) if where == "corner" else (shape[0] // 2, shape[1] // 2)
    light = one_pixel(*texel, 1e9, *shape)
    # The same patches in finer texels: what divides texels for the reference takes them for squares.
    fine = np.repeat(light.radiance, max(1, 256 // shape[0]), axis=0)
    fine = Environment(np.repeat(fine, max(1, 512 // shape[1]), axis=1))
    found, expected = mean_of(lit[0], light), reference(torus, slice(None), fine, 4096)
    assert np.isfinite(found).all() and (found >= 0).all()
    assert error(found, expected) < 0.025  # of which 64 rays leave up to 0.012
    np.testing.assert_allclose(light.sh(10), fine.sh(10), atol=1e-9 * np.abs(fine.sh(10)).max())


def test_pixels_that_hold_no_radiance_light_as_repaired_ones_do(lit):
    broken = rough_light().radiance.copy()
    repaired = broken.copy()
    broken[3, 4], broken[0, 9, 1], broken[9, 20, 2] = np.nan, -7.0, np.inf
    repaired[3, 4] = repaired[0, 9, 1] = 0.0
    repaired[9, 20, 2] = 5000.0  # the largest finite one is the sun
    with pytest.warns(DataWarning, match="1 NaN, 1 infinite, 1 negative") as caught:
        light = Environment(broken)
    assert len(caught) == 1
    np.testing.assert_array_equal(lit[0].shade(light), lit[0].shade(Environment(repaired)))


def _channels(image):
    return {color: np.ascontiguousarray(image[..., index]) for index, color in enumerate("RGB")}


EXR_FILES = {
    "float RGBA, transparent": lambda image: [({"RGBA": np.dstack([image, 0 * image[..., :1]])}, {})],
    "half luminance and alpha": lambda image: [({"Y": image[..., 0].astype(np.float16), "A": image[..., 1]}, {})],
    "parts, the second in a window": lambda image: [
        ({"Z": image[..., 0]}, {}),
        (_channels(image), {"dataWindow": ((0, 0), (31, 15)), "displayWindow": ((0, 0), (31, 15))}),
    ],
}


@pytest.mark.parametrize("kind", EXR_FILES)
def test_exr_files_light_as_their_pixels_do(lit, kind, tmp_path):
    image = rough_light().radiance
    if "half" in kind:
        image = np.repeat(image[..., :1].astype(np.float16).astype(np.float32), 3, axis=2)
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage, **header}, channels, f"part {index}")
        for index, (channels, header) in enumerate(EXR_FILES[kind](image))
    ]
    OpenEXR.File(parts).write(str(tmp_path / "sky.exr"))
    np.testing.assert_array_equal(
        lit[0].shade(Environment.load(tmp_path / "sky.exr")), lit[0].shade(Environment(image))
    )


# -- turns


def test_turns_by_nothing_whole_tiny_and_a_million_degrees(lit):
    light = rough_light()
    still = light.sh(10)
    for angle in (0.0, 360.0, -720.0, 3.6e8, 1e-10):
        np.testing.assert_array_equal(light.rotated(angle).sh(10), still)
    np.testing.assert_array_equal(lit[0].shade(light.rotated(360.0)), lit[0].shade(light))
    # A millionth of a degree: the derivative by the angle, and its square on top.
    small = np.radians(1e-6)
    step = np.degrees(1e-4)
    slope = (turned_about_y(still, step) - turned_about_y(still, -step)) / 2e-4
    turned = light.rotated(1e-6).sh(10)
    assert np.abs(turned - still - small * slope).max() < 1e-13 * np.abs(still).max() + 81 * small**2
    np.testing.assert_array_equal(light.rotated(1e6).sh(10), light.rotated(280.0).sh(10))
    angle = np.radians(1e6)
    cos, sin = np.cos(angle), np.sin(angle)
    expected = harmonics.rotation_matrix(np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]), 10) @ still
    np.testing.assert_allclose(turned_about_y(still, 1e6), expected, atol=1e-10 * np.abs(still).max())


# -- bounces


def cup():
    """An open box of 1 x 1 x 1, seen from inside: five gridded squares with hard edges."""
    floor = sheet(np.linspace(-0.5, 0.5, 9), -0.5)
    sides = []
    for axes in (
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
    ):
        for sign in (1.0, -1.0):
            axes = np.array(axes, float)
            sides.append((sign * floor[0] @ axes, sign * floor[1] @ axes, floor[2]))
    return joined(sides[0], *sides[2:])


def test_white_furnace_neither_loses_nor_makes_light():
    vertices, normals, faces = cup()
    white, sky = np.ones(vertices.shape, np.float32), Environment(np.ones((8, 16, 3), np.float32))
    relighter = ten_bands(scene(vertices, normals, faces), rays=64, effects=EVERYTHING)
    shading = relighter.shading(sky, white)
    direct = mean_of(relighter, sky)
    assert direct.mean() < 0.25 and shading.sun_count == 0 and len(shading.bounces) <= 64
    assert (shading.radiance >= direct).all()
    tolerance = shading.settings.bounce_tolerance  # of the mean: at the bottom of the cup more bounces are left out
    assert np.sqrt(np.square(shading.radiance - 1.0).mean()) < tolerance
    np.testing.assert_allclose(shading.radiance, 1.0, atol=2 * tolerance)
    before = direct
    for count in (1, 2, 4, 16, 64):
        radiance, given = with_bounces(direct, white, relighter.interreflection(), 0.0, count)
        assert len(given) == count and (radiance >= before).all() and radiance.max() <= 1 + 8 * EPS32
        before = radiance
    # What is left fades by the part that is hidden, on average: 0.8 a bounce.
    everything, _ = with_bounces(direct, white, relighter.interreflection(), 0.0, 200)
    np.testing.assert_allclose(everything, 1.0, atol=8 * EPS32)


def test_black_surfaces_end_it_and_no_albedo_but_0_to_1_will_do():
    vertices, normals, faces = cup()
    relighter = ten_bands(scene(vertices, normals, faces), rays=16, effects=EVERYTHING)
    shading = relighter.shading(rough_light(), np.zeros(vertices.shape))
    assert not shading.radiance.any() and shading.bounces == [0.0]
    for value in (np.nan, -0.01, 1.01, np.inf):
        albedo = np.full(vertices.shape, 0.5)
        albedo[7, 1] = value
        for chosen in (relighter, ten_bands(scene(vertices, normals, faces), "analytic")):
            with pytest.raises(InputError, match=r"albedo must be in \[0, 1\]"):
                chosen.shade(rough_light(), albedo)


# -- no light


def test_no_light_is_black_and_says_so(lit, tmp_path):
    black = Environment(np.zeros((16, 32, 3), np.float32))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for method in ("raytraced", "analytic"):
            relighter = ten_bands(scene(*knobbed_torus()), method, rays=8)
            shading = relighter.shading(black, np.full((498, 3), 0.7))
            assert not shading.radiance.any() and shading.sun_count == 0 and not any(shading.bounces)
    OpenEXR.File({}, {"RGB": np.zeros((16, 32, 3), np.float32)}).write(str(tmp_path / "night.exr"))
    scene(*knobbed_torus()).save(tmp_path / "ring")
    output = tmp_path / "lit"
    arguments = [
        tmp_path / "ring",
        "--env",
        tmp_path / "night.exr",
        "-o",
        output,
        "--rays",
        8,
        "--albedo",
        "captured",
        "--format",
        "npy",
        "png",
    ]
    assert cli.main([str(argument) for argument in arguments]) == 0
    assert not np.load(output / "radiance.npy").any()
    report = json.loads((output / "report.json").read_text())
    assert report["warnings"] == ["night.exr is black everywhere, and so is the scene"]
    assert np.isfinite(report["exposure"])


# -- what the result may not depend on


@pytest.fixture(scope="module")
def whole():
    """A scene of one chunk, its albedo, and everything about it."""
    lit = scene(*knobbed_torus())
    albedo = lit.colors_srgb / np.float32(255)
    return lit, albedo, everything(lit, albedo)


@pytest.mark.parametrize("chunks", [2, 7])
def test_chunks_change_no_bit_of_anything(whole, chunks):
    lit, albedo, expected = whole
    scenes = (Scene.from_mesh(lit.chunks[0], limit) for limit in range(40, 400))
    cut = next(found for found in scenes if len(found.chunks) == chunks)
    row = {content.tobytes(): index for index, content in enumerate(np.hstack([lit.vertices, lit.normals]))}
    rows = [row[content.tobytes()] for content in np.hstack([cut.vertices, cut.normals])]
    assert len(rows) > len(row)  # seams
    np.testing.assert_array_equal(everything(cut, albedo[rows]), expected[rows])


def row_sums(matrix, content):
    """Rows of the matrix, by vertex, as lists of (contents of a face's vertices, weights of the second and third)."""
    places = [
        ([content[corner] for corner in corners], tuple(parts))
        for corners, parts in zip(matrix._corners, matrix._parts, strict=True)
    ]
    rows = [places[begin:end] for begin, end in pairwise(matrix._starts)]
    return [rows[place] for place in np.argsort(matrix._rows)]


def test_copies_on_seams_are_one_vertex_of_the_matrix(whole):
    lit, albedo, _ = whole
    cut = Scene.from_mesh(lit.chunks[0], 60)
    matrices, given = [], []
    names = [[row.tobytes() for row in np.hstack([found.vertices, found.normals])] for found in (lit, cut)]
    for found, name in zip((lit, cut), names, strict=True):
        matrices.append(Interreflection(Occluder(found.vertices, found.normals, found.faces), 48))
        direct = np.repeat(np.sin(1e3 * found.vertices[:, :1]) + 1, 3, axis=1)
        colors = np.float32([albedo[names[0].index(vertex)] for vertex in name])
        given.append(with_bounces(direct, colors, matrices[-1])[1])
    np.testing.assert_allclose(given[1], given[0], rtol=1e-12)  # sums in another order
    rows = dict(zip(names[0], row_sums(matrices[0], names[0]), strict=True))
    assert (matrices[1].shares < 1).any() and (matrices[0].shares == 1).all()
    for vertex, row in zip(names[1], row_sums(matrices[1], names[1]), strict=True):
        assert row == rows[vertex]


def test_order_of_vertices_and_faces_changes_no_bit_of_anything(whole):
    lit, albedo, expected = whole
    rng = np.random.default_rng(4)
    order = rng.permutation(len(albedo))
    faces = np.argsort(order)[lit.faces][rng.permutation(len(lit.faces))].astype(np.int32)
    mesh = Mesh(lit.vertices[order], lit.normals[order], faces, lit.colors_srgb[order])
    np.testing.assert_array_equal(everything(Scene([mesh]), albedo[order]), expected[order])


def test_threads_change_no_bit_of_anything(whole, monkeypatch):
    lit, albedo, expected = whole
    for threads in (1, 2, 7):
        monkeypatch.setattr(os, "cpu_count", lambda threads=threads: threads)
        np.testing.assert_array_equal(everything(lit, albedo), expected)
    # Libraries read the number of threads when they start.
    code = """
import hashlib, hard_scenes, numpy
lit = hard_scenes.scene(*hard_scenes.knobbed_torus())
print(hashlib.sha256(hard_scenes.everything(lit, lit.colors_srgb / numpy.float32(255)).tobytes()).hexdigest())
"""
    other = {"OPENBLAS_NUM_THREADS": "3", "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    assert os.environ["OPENBLAS_NUM_THREADS"] != "3" and numba.config.NUMBA_NUM_THREADS > 1
    env = os.environ | other | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == hashlib.sha256(expected.tobytes()).hexdigest()
