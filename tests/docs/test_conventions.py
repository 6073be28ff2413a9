"""docs/conventions.md against the code: its tables and formulas are read from the page and evaluated."""

import importlib
import json
import re
from dataclasses import fields
from itertools import takewhile
from pathlib import Path

import numpy as np
import pygltflib
import pytest
from scipy.spatial.transform import Rotation
from splat_samples import make_splats, unit_vectors

from relight import Environment, cli
from relight.light import projections
from relight.light.captured_light import LikelyLight
from relight.light.sun_position import toward
from relight.output.kinds import FILES, OF_SPLATS
from relight.sh import harmonics
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import write_mesh_ply
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats
from splat2mesh.views.upright import scene_from_splat

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")
MATH = {"pi": np.pi, "sin": np.sin, "cos": np.cos, "asin": np.arcsin, "atan2": np.arctan2, "np": np, "sh": harmonics}

HEIGHT, WIDTH = 8, 24  # texels of 15 degrees: every angle used below is a whole number of them


def table(*header):
    """The rows, as lists of cells without backticks, of the page's table whose header starts with these cells."""
    lines = [line.strip().replace("`", "") for line in PAGE.splitlines()]
    head = "| " + " | ".join(header) + " |"
    (start,) = (i for i, line in enumerate(lines) if line.startswith(head) and lines[i + 1].startswith("|---"))
    rows = takewhile(lambda line: line.startswith("|"), lines[start + 2 :])
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def names(*header):
    """The names in the first column of that table, where a row may give several."""
    return {name for row in table(*header) for name in row[0].split(", ")}


def value(formula, **variables):
    """A formula of the page as a number, array or tuple."""
    return eval(formula, MATH | variables)


def constants(name):
    """The line `name = a, b, ...` of the page as an array."""
    return np.array(value(re.search(rf"^{name} = (.+)$", PAGE, re.MULTILINE)[1]))


def mapped(formula, directions):
    """A map such as "(x, -z, y)" applied to directions: (..., 3) -> (..., 3)."""
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack(value(formula, x=x, y=y, z=z), axis=-1)


def looked_up(row, image, directions):
    """Texels of a lat-long image that a tool (a row of the table of tools) finds in directions of its own axes.

    directions: (..., 3) that hit texel centres. Returns (..., 3).
    """
    x, y, z = np.moveaxis(directions, -1, 0)
    column = value(row[1], x=x, y=y, z=z) * WIDTH - 0.5
    line = value(row[2], x=x, y=y, z=z) * HEIGHT - 0.5
    for position in (column, line):  # centres of texels: the rounding below changes nothing but the last bits
        np.testing.assert_allclose(position, np.rint(position), atol=1e-9)
    return image[np.rint(line).astype(int), np.rint(column).astype(int) % WIDTH]


def turn_y(angle_deg):
    return Rotation.from_euler("y", angle_deg, degrees=True).as_matrix()


@pytest.fixture(scope="module")
def image():
    return np.random.default_rng(0).exponential(size=(HEIGHT, WIDTH, 3)).astype(np.float32)


TOOLS = [pytest.param(row, id=row[0].split(",")[0]) for row in table("tool", "u", "v")]

# -- frames and splats


@pytest.mark.parametrize("row", [row for row in table("--up") if row[0] != "auto"], ids=lambda row: row[0])
def test_up_turns_the_splat_as_documented(row):
    directions, turn = unit_vectors(20), scene_from_splat(row[0])[:3, :3]
    np.testing.assert_array_equal(mapped(row[1], directions), directions @ turn.T)
    angle = 0 if row[2] == "none" else int(re.fullmatch(r"Rx\(([+-]?\d+)\)", row[2])[1])
    np.testing.assert_allclose(turn, Rotation.from_euler("x", angle, degrees=True).as_matrix(), atol=1e-15)


def test_half_a_turn_about_x_leaves_a_splat_looking_the_same():
    """Turned splats seen by a turned eye: the same covariances, turned, and the same colours."""
    splats, eye = make_splats(100, 3), np.array([0.4, -3.0, 1.5])
    turn = Rotation.from_euler("x", 180, degrees=True).as_matrix()
    means, quats = re.search(r"means become `(.+?)` and quaternions\n?\s*`(.+?)`", PAGE).groups()
    w, x, y, z = splats.quats_wxyz.T
    flipped = Splats(
        mapped(means, splats.means),
        splats.scales,
        np.stack(value(quats, w=w, x=x, y=y, z=z), axis=-1),
        splats.opacities,
        splats.sh * constants("rx180")[:, None],
    )
    np.testing.assert_allclose(flipped.means, splats.means @ turn.T, atol=1e-7)
    # Signs only, so all that differs is the order of float32 sums: some 1e-7 of the largest variance.
    largest = splats.scales.max(axis=1)[:, None, None] ** 2
    np.testing.assert_allclose(
        flipped.covariances() / largest, turn @ splats.covariances() @ turn.T / largest, atol=1e-6
    )
    np.testing.assert_allclose(flipped.colors_toward(turn @ eye), splats.colors_toward(eye), atol=1e-5)
    # The same signs in our basis: they belong to the functions, not to their sign convention.
    np.testing.assert_allclose(harmonics.rotation_matrix(turn, 4), np.diag(constants("rx180")), atol=1e-13)


@pytest.mark.parametrize("eye", [(0.0, 0.0, -5.0), (3.0, 2.0, 4.0), (-4.0, 1.0, -2.0)])
def test_3dgs_signs_are_those_the_rasteriser_draws(eye):
    """The pixel that shows a splat's centre has the colour of `from_3dgs` coefficients in our basis."""
    coefficients = np.random.default_rng(3).normal(0.0, 0.08, (1, 16, 3))
    splat = Splats([[0.5, -0.2, 0.3]], [[0.5] * 3], [[1, 0, 0, 0]], [0.9], coefficients)
    toward = splat.means[0] - np.array(eye)
    expected = 0.5 + harmonics.evaluate(toward[None] / np.linalg.norm(toward), 4) @ harmonics.from_3dgs(splat.sh)[0]
    assert expected.min() > 0.05  # so that nothing is clamped
    np.testing.assert_allclose(splat.colors_toward(eye), expected, atol=1e-6)  # float32
    rendering = rasterize(splat, View.look_at(eye, splat.means[0], (0, 1, 0), 20.0, 33))
    seen = rendering.color[16, 16] / rendering.alpha[16, 16]
    np.testing.assert_allclose(seen, expected[0], atol=1e-5)  # float32, blended and divided


# -- environment images


@pytest.mark.parametrize("row", table("direction"), ids=lambda row: row[0])
def test_landmarks_of_the_canonical_image(row):
    """An image whose red grows to the right and green downwards shows where a lookup lands."""
    axis = {"x": 0, "y": 1, "z": 2}[row[0][1]]
    direction = np.eye(3)[axis] * (1 if row[0][0] == "+" else -1)
    down, right = np.meshgrid((np.arange(64) + 0.5) / 64, (np.arange(128) + 0.5) / 128, indexing="ij")
    # A triangle wave, since u itself jumps at the seam: 0 at u = 0, 1 at u = 1/2, and a quarter wave further.
    waves = [1 - np.abs(2 * ((right + shift) % 1) - 1) for shift in (0.0, 0.25)]
    found = Environment(np.stack([*waves, down], axis=-1)).lookup(direction[None])[0]
    half = 0.5 / 64  # the last texel centre before a pole, or before a wave's crest, is half a texel away
    assert found[2] == pytest.approx(value(row[2]), abs=1.01 * half)
    if row[1] != "any":
        expected = [1 - abs(2 * ((value(row[1]) + shift) % 1) - 1) for shift in (0.0, 0.25)]
        np.testing.assert_allclose(found[:2], expected, atol=1.01 * half)


def test_directions_of_texels_are_the_documented_formula():
    u, v = np.meshgrid((np.arange(WIDTH) + 0.5) / WIDTH, (np.arange(HEIGHT) + 0.5) / HEIGHT)
    lon, lat, direction = re.search(r"With `lon = (.+?)` and `lat = (.+?)` a direction is\n`(.+?)`", PAGE).groups()
    angles = {"lon": value(lon, u=u), "lat": value(lat, v=v)}
    expected = np.stack(value(direction, **angles), axis=-1)
    np.testing.assert_allclose(projections.texel_directions(HEIGHT, WIDTH), expected, atol=1e-15)


def test_toward_the_sun_is_the_documented_formula():
    direction = re.search(r"the direction toward the sun is\n`(.+?)`", PAGE)[1]
    for azimuth, height, north in ((0, 10, 0), (75, 30, 0), (210, 35, 20), (-40, 80, -130)):
        expected = value(direction, A=np.radians(azimuth - north), e=np.radians(height))
        np.testing.assert_allclose(toward(azimuth, height, north), expected, atol=1e-15)


def test_entries_of_captured_light_are_documented():
    documented = {name.split(" (")[0] for name in names("entry", "meaning")}
    assert documented == {each.name for each in fields(LikelyLight)}


@pytest.mark.parametrize("angle", [15, 90, -45, 345])
def test_rotation_by_whole_texels_is_the_documented_roll(image, angle):
    rolled = value(re.search(r"`(np\.roll\(.+?\))`", PAGE)[1], image=image, W=WIDTH, a=angle, round=round)
    directions = projections.texel_directions(HEIGHT, WIDTH).reshape(-1, 3)
    found = Environment(image).rotated(angle).lookup(directions)
    np.testing.assert_allclose(found, rolled.reshape(-1, 3), rtol=1e-5)  # float32, and bilinear at a centre


def test_a_quarter_turn_takes_the_light_from_plus_z_to_plus_x(image):
    light = Environment(image)
    np.testing.assert_allclose(light.rotated(90).lookup([[1, 0, 0]]), light.lookup([[0, 0, 1]]), rtol=1e-5)


@pytest.mark.parametrize("row", TOOLS)
def test_every_tool_finds_the_same_texel(row, image):
    directions = projections.texel_directions(HEIGHT, WIDTH)
    np.testing.assert_array_equal(looked_up(row, image, mapped(row[3], directions)), image)
    handedness = [np.linalg.det(mapped(formula, np.eye(3))) for formula in row[3:5]]
    assert handedness == ([-1, -1] if "left-handed" in row[0] else [1, 1])  # so neither image nor mesh is mirrored


@pytest.mark.parametrize("row", TOOLS)
def test_rotate_shows_what_the_tool_shows(row, image):
    """A mesh imported there sees in each direction what the same mesh here sees with the documented --rotate."""
    angle = value(row[5])
    directions = projections.texel_directions(HEIGHT, WIDTH) @ turn_y(angle).T
    there = looked_up(row, image, mapped(row[4], directions))
    here = Environment(image).rotated(angle).lookup(directions.reshape(-1, 3))
    np.testing.assert_allclose(here, there.reshape(-1, 3), rtol=1e-5)  # float32, and bilinear at a centre


@pytest.mark.parametrize("turn_deg", [0, 30, -105])
@pytest.mark.parametrize("setting", table("tool", "setting"), ids=lambda row: row[0])
def test_rotate_follows_the_tools_own_turn(setting, turn_deg, image):
    """Blender's Mapping node turns the vector that is looked up; Unity's shader turns the sky it draws.

    Both by [[cos, -sin], [sin, cos]]: Blender on (x, y), Unity on (x, z).
    """
    (row,) = (row for (row,) in (tool.values for tool in TOOLS) if row[0].startswith(setting[0]))
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    if setting[0] == "Blender":
        lookup = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    else:
        lookup = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]]).T  # what is drawn at R d was looked up at d
    angle = value(setting[2], t=turn_deg)
    directions = projections.texel_directions(HEIGHT, WIDTH) @ turn_y(angle).T
    there = looked_up(row, image, mapped(row[4], directions) @ lookup.T)
    here = Environment(image).rotated(angle).lookup(directions.reshape(-1, 3))
    np.testing.assert_allclose(here, there.reshape(-1, 3), rtol=1e-5)


# -- spherical harmonics


def test_the_basis_is_the_documented_polynomials():
    directions = unit_vectors(50)
    x, y, z = directions.T
    formulas = re.search(r"^basis = (.+)$", PAGE, re.MULTILINE)[1]
    polynomials = np.stack(np.broadcast_arrays(*value(formulas, x=x, y=y, z=z)), axis=-1)
    ratio = harmonics.evaluate(directions, 3) / polynomials
    np.testing.assert_allclose(ratio, np.broadcast_to(ratio[0], ratio.shape), rtol=1e-9)  # near zeros: cancellation
    # Those constants, all positive, are the ones that Unity stores coefficients times.
    np.testing.assert_allclose(ratio[0], constants("unity"), atol=5.1e-7)  # six digits


def test_lambert_coefficients_are_the_documented_ones():
    np.testing.assert_allclose(harmonics.lambert_coefficients(7), constants("lambert"), atol=1e-15)
    np.testing.assert_allclose(
        constants("unity") * constants("lambert")[[0, 1, 1, 1, 2, 2, 2, 2, 2]] / np.pi,
        constants("unity_from_radiance"),
        atol=1e-6,  # six digits each
    )


def irradiance(coefficients, normals):
    """Irradiance (N, 3) of the light on plane receivers, by integrating it over each one's hemisphere.

    Gauss-Legendre in the cosine times equal steps around: exact for light of few bands, which is a polynomial.
    """
    node, weight = np.polynomial.legendre.leggauss(8)
    cosine, weight = (node + 1) / 2, weight / 2
    around = 2 * np.pi * np.arange(16) / 16
    cosine, around = (grid.ravel() for grid in np.meshgrid(cosine, around, indexing="ij"))
    sine = np.sqrt(1 - cosine**2)
    local = np.stack([sine * np.cos(around), sine * np.sin(around), cosine], axis=-1)
    weights = np.repeat(weight, 16) * (2 * np.pi / 16) * cosine
    total = []
    for normal in normals:
        turn, _ = Rotation.align_vectors(normal[None], [[0.0, 0.0, 1.0]])
        total.append(weights @ (harmonics.evaluate(turn.apply(local), 3) @ coefficients))
    return np.array(total)


def positive(stored, normals):
    """three.js SphericalHarmonics3.getIrradianceAt: its constants, radiance coefficients."""
    x, y, z = normals.T
    factors = [0.886227, 2 * 0.511664 * y, 2 * 0.511664 * z, 2 * 0.511664 * x, 2 * 0.429043 * x * y]
    factors += [2 * 0.429043 * y * z, 0.743125 * z * z - 0.247708, 2 * 0.429043 * x * z, 0.429043 * (x * x - y * y)]
    return np.stack(np.broadcast_arrays(*factors), axis=-1) @ stored


def babylon(stored, normals):
    """Babylon.js: times 1 / pi on reading, then its basis, which changes sign with m; here back to irradiance."""
    signs = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1])
    x, y, z = normals.T
    root = np.sqrt([1, 3, 3, 3, 15, 15, 5 / 4, 15, 15 / 4]) / np.sqrt(4 * np.pi)
    terms = np.broadcast_arrays(1.0, y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y)
    return np.pi * (np.stack(terms, axis=-1) * (signs * root)) @ (stored / np.pi)


def unity(stored, normals):
    """Unity's packing into SHA, SHB, SHC and its ShadeSH9, for normals with x the other way; irradiance."""
    x, y, z = (normals * [-1, 1, 1]).T
    s = stored[:, :, None]
    linear = s[:, 3] * x + s[:, 1] * y + s[:, 2] * z + (s[:, 0] - s[:, 6])
    quadratic = s[:, 4] * x * y + s[:, 5] * y * z + 3 * s[:, 6] * z * z + s[:, 7] * z * x
    return np.pi * (linear + quadratic + s[:, 8] * (x * x - y * y)).T


READERS = {"relight": positive, "glTF": babylon, "Unity": unity}


@pytest.mark.parametrize("reader", READERS)
def test_other_systems_get_the_light_they_expect(reader):
    """What the page says to store, read as that system reads it, gives the irradiance of our light."""
    coefficients, normals = np.random.default_rng(5).normal(size=(9, 3)), unit_vectors(40)
    (formula,) = (row[3] for row in table("system") if row[0].startswith(reader))
    known = {"unity": constants("unity"), "x_flip": constants("x_flip")}
    stored = value(formula, c=coefficients, **known)
    assert stored.shape == ((3, 9) if reader == "Unity" else (9, 3))
    found = READERS[reader](stored, normals)
    # Constants of six digits, nine of them times coefficients of up to 3.
    np.testing.assert_allclose(found, irradiance(coefficients, normals), atol=3e-5)


def test_3dgs_row_is_the_sign_of_m():
    (formula,) = (row[3] for row in table("system") if row[0].startswith("3DGS"))
    coefficients = np.random.default_rng(6).normal(size=(16, 3))
    _, order = harmonics.degrees_and_orders(4)
    np.testing.assert_array_equal(value(formula, c=coefficients), coefficients * (-1.0) ** order[:, None])


# -- files


def small_mesh():
    rng = np.random.default_rng(7)
    normals = rng.normal(size=(60, 3))
    return Mesh(
        rng.normal(size=(60, 3)).astype(np.float32),
        (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        rng.integers(0, 60, (40, 3), dtype=np.int32),
        rng.integers(0, 256, (60, 3), dtype=np.uint8),
    )


def test_scene_folder_holds_what_is_documented(tmp_path):
    Scene.from_mesh(small_mesh(), 30).save(tmp_path / "scene")
    meta = json.loads((tmp_path / "scene" / "scene.json").read_text(encoding="utf-8"))
    assert set(meta) == names("scene.json")
    (entry_row,) = (row[1] for row in table("scene.json") if row[0] == "chunks")
    assert [name for name in meta["chunks"][0] if name not in entry_row] == []
    header = (tmp_path / "scene" / "chunks" / "0000.ply").read_bytes().split(b"end_header")[0].decode()
    floats, bytes_ = re.search(r"float `([a-z ]+)` and uchar `([a-z ]+)` per vertex", PAGE).groups()
    expected = [f"float {name}" for name in floats.split()] + [f"uchar {name}" for name in bytes_.split()]
    assert re.findall(r"^property ((?:float|uchar) \w+)$", header, re.MULTILINE) == expected
    assert "format binary_little_endian 1.0" in header


def test_relight_writes_what_is_documented(tmp_path):
    Scene.from_mesh(small_mesh(), 30).save(tmp_path / "scene")
    out = tmp_path / "out"
    kinds = [kind for kind in FILES if kind not in OF_SPLATS]  # this scene was not made from any
    options = "--method", "analytic", "--albedo", "captured", "--format", *kinds, "--live", "-q"
    assert cli.main(list(map(str, (tmp_path / "scene", "-o", out, *options)))) == 0
    write_mesh_ply(tmp_path / "mesh.ply", small_mesh())
    baked = tmp_path / "baked"
    options = "--bake", "texture", "transfer", "--texture-size", "64", "--tolerance", "0.1", "--format", "npy", "-q"
    assert cli.main(list(map(str, (tmp_path / "mesh.ply", "-o", baked, *options)))) == 0
    written = {path.name for folder in (out, baked) for path in folder.iterdir()}
    assert written | {FILES[kind] for kind in OF_SPLATS} == names("file", "content")
    report, other = (json.loads((folder / "report.json").read_text(encoding="utf-8")) for folder in (out, baked))
    assert set(report) | set(other) == names("report.json")
    extras = pygltflib.GLTF2().load(out / "relit.glb").scenes[0].extras
    assert set(extras) == names("extras")
    assert extras["exposure"] == report["exposure"] and extras["clipped_vertices"] == report["clipped_vertices"]
    exposed = np.load(out / "radiance.npy") * np.float32(report["exposure"])
    assert extras["clipped_vertices"] == (exposed > 1).any(axis=1).sum()


# -- the page itself


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`((?:splat2mesh|relight)(?:\.\w+)+)`", PAGE))))
def test_code_that_the_page_names_exists(name):
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[count:]:
            found = getattr(found, attribute)
        return
    raise AssertionError(f"no module of {name} can be imported")


def test_tests_that_the_page_names_exist():
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PAGE)
    assert len(named) > 20
    missing = [f"{file}::{test}" for file, test in named if f"def {test}(" not in (ROOT / file).read_text("utf-8")]
    assert missing == []
