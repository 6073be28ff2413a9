"""Environments: where their light comes from, files of every kind, repairs and refusals."""

import warnings

import imagecodecs
import numpy as np
import OpenEXR
import pytest
from color_primaries import PRIMARIES, expected_matrix

from relight import Environment, cli
from relight.light.color_spaces import SPACES, converted
from relight.output.images import write_exr
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import write_mesh_ply


def _texel_direction(row, column, height, width):
    """Centre of a texel by the definition in ImfEnvmap.h, written out once more."""
    longitude = np.pi * (1 - 2 * (column + 0.5) / width)
    latitude = np.pi * (0.5 - (row + 0.5) / height)
    x, z = np.sin(longitude) * np.cos(latitude), np.cos(longitude) * np.cos(latitude)
    return np.array(np.broadcast_arrays(x, np.sin(latitude), z))


def _turned(direction, angle_deg):
    angle = np.radians(angle_deg)
    x, y, z = direction
    return np.array([np.cos(angle) * x + np.sin(angle) * z, y, np.cos(angle) * z - np.sin(angle) * x])


def _noise(height, width, seed=0):
    return np.random.default_rng(seed).exponential(size=(height, width, 3)).astype(np.float32)


def _write_exr(path, channels, **header):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    OpenEXR.File(header, channels).write(str(path))
    return path


# --- directions ---


@pytest.mark.parametrize(("row", "column"), [(10, 20), (0, 3), (31, 40), (16, 0), (16, 63)])
@pytest.mark.parametrize("angle_deg", [0.0, 45.0, -77.3])
def test_one_lit_pixel_lights_from_exactly_its_direction(row, column, angle_deg):
    """Inside, in both polar rows and on both sides of the seam."""
    image = np.zeros((32, 64, 3), np.float32)
    image[row, column] = 65504.0  # the largest half float
    light = Environment(image).rotated(angle_deg)
    direction = _turned(_texel_direction(row, column, 32, 64), angle_deg)
    # Rounding moves the lookup by some 1e-14 of a texel, and the result is float32.
    np.testing.assert_allclose(light.lookup(direction[None])[0], 65504.0, rtol=1e-6)

    first_moment = light.sh(2)[[3, 1, 2], 1] / np.sqrt(3 / (4 * np.pi))  # x, y, z
    steps = (np.arange(100) + 0.5) / 100 - 0.5
    spread = _texel_direction(row + steps[:, None], column + steps, 32, 64)
    weight = np.hypot(spread[0], spread[2])
    centroid = _turned((spread * weight).sum(axis=(1, 2)) / weight.sum(), angle_deg)
    expected = centroid * 65504.0 * _texel_area(row, 32, 64)
    # Midpoint rule at a hundredth of a texel, 0.001 rad: its square over 24, more in the row at the pole.
    np.testing.assert_allclose(first_moment, expected, atol=1e-5 * np.linalg.norm(expected))


def _texel_area(row, height, width):
    return 2 * np.pi / width * (np.cos(np.pi * row / height) - np.cos(np.pi * (row + 1) / height))


@pytest.mark.parametrize(("height", "width"), [(8, 16), (5, 7), (1, 1), (2, 3)])
def test_lookup_at_texel_centers_returns_the_texels(height, width):
    image = _noise(height, width)
    grid = [(row, column) for row in range(height) for column in range(width)]
    directions = np.array([_texel_direction(*texel, height, width) for texel in grid])
    found = Environment(image).lookup(directions)
    np.testing.assert_allclose(found, image.reshape(-1, 3), rtol=1e-5)  # float32


@pytest.mark.parametrize(("height", "width"), [(8, 16), (5, 7), (1, 1)])
def test_lookup_is_continuous_across_seam_and_poles(height, width):
    light = Environment(_noise(height, width))
    rng = np.random.default_rng(1)
    seam = np.stack([np.zeros(50), rng.normal(size=50), -np.ones(50)], axis=1)
    step = np.array([1e-7, 0.0, 0.0])
    np.testing.assert_allclose(light.lookup(seam + step), light.lookup(seam - step), atol=1e-4)
    # All around a pole, lookups a little on either side of it agree: there is one value for one direction.
    angle = 2 * np.pi * np.arange(width) / width
    ring = np.stack([1e-7 * np.sin(angle), np.ones(width), 1e-7 * np.cos(angle)], axis=1)
    for sign in (1, -1):
        across = light.lookup(ring * [1, sign, 1]) - light.lookup(ring * [-1, sign, -1])
        np.testing.assert_allclose(across, 0.0, atol=1e-4)


def test_lookup_ignores_the_length_of_directions_and_stays_in_range():
    image = _noise(6, 9)
    directions = np.random.default_rng(2).normal(size=(500, 3))
    found = Environment(image).lookup(directions)
    np.testing.assert_allclose(found, Environment(image).lookup(40.0 * directions), rtol=1e-5)
    assert found.dtype == np.float32 and found.min() >= image.min() and found.max() <= image.max()


# --- rotation ---


@pytest.mark.parametrize("angle_deg", [0.0, 45.0, 0.1, 33.3, 359.9])
def test_whole_turns_change_nothing_to_the_bit(angle_deg):
    light = Environment(_noise(8, 16))
    directions = np.random.default_rng(3).normal(size=(100, 3))
    for turns in (-720.0, -360.0, 360.0, 3600.0):
        again = light.rotated(angle_deg + turns)
        assert again.rotation_deg == light.rotated(angle_deg).rotation_deg
        np.testing.assert_array_equal(again.sh(9), light.rotated(angle_deg).sh(9))
        np.testing.assert_array_equal(again.lookup(directions), light.rotated(angle_deg).lookup(directions))


def test_rotation_rolls_the_image_to_the_left():
    image = _noise(8, 16)
    rolled, turned = Environment(np.roll(image, -2, axis=1)), Environment(image).rotated(45.0)
    np.testing.assert_allclose(turned.sh(10), rolled.sh(10), atol=1e-12)
    directions = np.random.default_rng(4).normal(size=(200, 3))
    np.testing.assert_allclose(turned.lookup(directions), rolled.lookup(directions), rtol=1e-4, atol=1e-5)


def test_rotations_add_up_and_share_the_image():
    light = Environment(_noise(8, 16), "sky")
    turned = light.rotated(300.0).rotated(100.0)
    assert turned.rotation_deg == 40.0 and light.rotation_deg == 0.0 and turned.name == "sky"
    assert turned.radiance is light.radiance
    assert turned.mean_luminance == pytest.approx(light.mean_luminance, rel=1e-14)


def test_rotation_by_no_number_is_refused():
    with pytest.raises(InputError, match="finite number of degrees, found nan"):
        Environment(_noise(2, 4)).rotated(float("nan"))


# --- averages ---


@pytest.mark.parametrize("shape", [(1, 1), (256, 512), (7, 5)])
def test_constant_sky(shape):
    light = Environment(np.broadcast_to(np.float32([2.0, 1.0, 0.5]), (*shape, 3)))
    assert light.mean_luminance == pytest.approx(2 * 0.2126 + 0.7152 + 0.5 * 0.0722, rel=1e-12)
    np.testing.assert_allclose(light.sh(10)[1:], 0.0, atol=1e-12)
    np.testing.assert_allclose(light.lookup(np.eye(3)), [[2.0, 1.0, 0.5]] * 3, rtol=1e-6)


def test_mean_luminance_weighs_texels_by_solid_angle():
    image = np.zeros((8, 16, 3))
    image[0, 5] = 1.0
    expected = _texel_area(0, 8, 16) / (4 * np.pi)
    assert Environment(image).mean_luminance == pytest.approx(expected, rel=1e-12)


def test_coefficients_are_the_callers_to_change():
    light = Environment(_noise(4, 8))
    light.sh(3)[:] = 0.0
    assert np.abs(light.sh(3)).max() > 0.1


def test_radiance_is_a_copy_that_cannot_be_changed():
    image = _noise(4, 8)
    light = Environment(image)
    image[:] = 0.0
    assert light.radiance.min() > 0.0
    with pytest.raises(ValueError, match="read-only"):
        light.radiance[0] = 1.0


# --- files ---

IMAGE = _noise(4, 8, seed=5)
RED, GREEN, BLUE = (np.ascontiguousarray(IMAGE[..., c]) for c in range(3))
ALPHA = np.ones((4, 8, 1), np.float32)
EXR_CHANNELS = {
    "RGB float": {"RGB": IMAGE},
    "RGB half": {"RGB": IMAGE.astype(np.float16)},
    "RGBA half": {"RGBA": np.concatenate([IMAGE, ALPHA], axis=2).astype(np.float16)},
    "separate": {"R": RED, "G": GREEN, "B": BLUE},
    "mixed types": {"R": RED.astype(np.float16), "G": GREEN, "B": BLUE},
    "a layer": {"sky.R": RED, "sky.G": GREEN, "sky.B": BLUE, "Z": RED},
}


@pytest.mark.parametrize("kind", EXR_CHANNELS)
def test_exr_channels_of_every_kind(kind, tmp_path):
    light = Environment.load(_write_exr(tmp_path / "sky.exr", EXR_CHANNELS[kind]))
    # Half floats carry 11 bits: rounding moves them by up to 2^-11.
    tolerance = 2.0**-11 if "half" in kind or "mixed" in kind else 0.0
    np.testing.assert_allclose(light.radiance, IMAGE, rtol=tolerance)
    assert light.name == "sky" and light.repaired == {}


def test_luminance_only_exr_is_grey(tmp_path):
    light = Environment.load(_write_exr(tmp_path / "y.exr", {"Y": RED}))
    np.testing.assert_array_equal(light.radiance, np.repeat(RED[..., None], 3, axis=2))


def test_first_part_with_color_is_taken(tmp_path):
    contents = {"depth": {"Z": RED}, "beauty": {"RGB": IMAGE}, "other": {"RGB": 2 * IMAGE}}
    with pytest.warns(DataWarning, match="of 2 layers beauty is the light; other left out"):
        light = Environment.load(_write_parts(tmp_path / "parts.exr", contents))
    np.testing.assert_array_equal(light.radiance, IMAGE)


def _write_parts(path, contents):
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage}, pixels, name) for name, pixels in contents.items()]
    OpenEXR.File(parts).write(str(path))
    return path


def _layer(name, image=2 * IMAGE):
    return {f"{name}.{color}": np.ascontiguousarray(image[..., k]) for k, color in enumerate("RGB")}


LAYERS = {
    "unnamed": ({"RGB": IMAGE} | _layer("Combined") | _layer("AO"), "its unnamed layer"),
    "Blender": (_layer("ViewLayer.AO") | _layer("ViewLayer.Combined", IMAGE), "ViewLayer.Combined"),
    "two view layers": (_layer("A.AO") | _layer("B.Combined", IMAGE) | _layer("B.DiffCol"), "B.Combined"),
    "the compositor": (_layer("Composite.Combined", IMAGE) | _layer("ViewLayer.Combined"), "Composite.Combined"),
    "luminance": ({"Y": RED} | _layer("AO"), "its unnamed layer"),
    "neither": (_layer("direct", IMAGE) | _layer("indirect"), "direct"),
}


@pytest.mark.parametrize("kind", LAYERS)
def test_of_several_layers_the_picture_is_the_light_and_is_named(kind, tmp_path):
    channels, name = LAYERS[kind]
    with pytest.warns(DataWarning, match=f"of [23] layers {name} is the light; .* left out"):
        light = Environment.load(_write_exr(tmp_path / "layers.exr", channels))
    wanted = np.repeat(RED[..., None], 3, axis=2) if kind == "luminance" else IMAGE
    np.testing.assert_array_equal(light.radiance, wanted)


PARTS = {
    "Blender": ({"V.AO": _layer("V.AO"), "V.Combined": _layer("V.Combined", IMAGE)}, "V.Combined"),
    "unnamed channels": ({"V.AO": {"RGB": 2 * IMAGE}, "V.Combined": {"RGB": IMAGE}}, "V.Combined"),
    "Nuke": ({"albedo": {"RGB": 2 * IMAGE}, "rgba": {"RGB": IMAGE}, "depth": {"Z": RED}}, "rgba"),
}


@pytest.mark.parametrize("kind", PARTS)
def test_of_several_parts_the_picture_is_the_light_and_is_named(kind, tmp_path):
    contents, name = PARTS[kind]
    with pytest.warns(DataWarning, match=f"of 2 layers (V.Combined.)?{name} is the light; .* left out"):
        light = Environment.load(_write_parts(tmp_path / "parts.exr", contents))
    np.testing.assert_array_equal(light.radiance, IMAGE)


# --- colour spaces ---


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
@pytest.mark.parametrize("space", ["AP0", "AP1", "Rec.2020", "XYZ", "P3", "Rec.709"])
def test_a_picture_in_another_space_gives_the_same_light(space, dtype, tmp_path):
    """Half floats carry 11 bits, and the inverse of the widest space multiplies their rounding by five."""
    stored = (IMAGE @ expected_matrix(PRIMARIES[space]).T).astype(dtype)
    path = _write_exr(tmp_path / "a.exr", {"RGB": stored}, chromaticities=PRIMARIES[space])
    bound = (1e-5 if dtype == np.float32 else 5 * 2.0**-11) * IMAGE.max(axis=2, keepdims=True)
    assert (np.abs(Environment.load(path).radiance - IMAGE) <= bound).all()


def test_passes_are_read_back_as_they_were_written_without_a_word_about_black(tmp_path):
    pure = IMAGE * np.array([1.0, 0.0, 0.0], np.float32)
    for name, space in SPACES.items():
        path, header = tmp_path / f"{name}.exr", {"chromaticities": space.chromaticities}
        write_exr(path, {"RGB": converted(pure, space)}, header)
        np.testing.assert_allclose(Environment.load(path).radiance, pure, atol=1e-6 * pure.max())
    write_exr(path, {"RGB": IMAGE}, {"chromaticities": SPACES["srgb"].chromaticities})
    np.testing.assert_array_equal(Environment.load(path).radiance, IMAGE)


def test_chromaticities_that_span_nothing_are_ignored_with_a_warning(tmp_path):
    for bad in ((0.0,) * 8, (0.64, 0.33) * 4, (np.nan, *PRIMARIES["AP1"][1:]), (*PRIMARIES["AP1"][:7], 0.0)):
        path = _write_exr(tmp_path / "a.exr", {"RGB": IMAGE}, chromaticities=bad)
        with pytest.warns(DataWarning, match="span no colours, and are ignored"):
            np.testing.assert_array_equal(Environment.load(path).radiance, IMAGE)


@pytest.mark.parametrize(("left", "top"), [(3, 2), (-2, -1), (10, 1), (-5, 5)])
def test_data_window_is_pasted_into_the_display_window(left, top, tmp_path):
    """Inside 16 x 8 pixels, over their upper left corner, their right edge, their lower left corner."""
    path = _write_exr(
        tmp_path / "window.exr",
        {"RGB": IMAGE},
        dataWindow=((left, top), (left + 7, top + 3)),
        displayWindow=((0, 0), (15, 7)),
    )
    expected = np.zeros((8, 16, 3), np.float32)
    for row in range(4):
        for column in range(8):
            if 0 <= row + top < 8 and 0 <= column + left < 16:
                expected[row + top, column + left] = IMAGE[row, column]
    np.testing.assert_array_equal(Environment.load(path).radiance, expected)


def test_windows_that_start_elsewhere_than_at_zero(tmp_path):
    window = ((100, -50), (107, -47))
    path = _write_exr(tmp_path / "shifted.exr", {"RGB": IMAGE}, dataWindow=window, displayWindow=window)
    np.testing.assert_array_equal(Environment.load(path).radiance, IMAGE)


def test_radiance_hdr(tmp_path):
    path = tmp_path / "sky.hdr"
    bright = IMAGE.copy()
    bright[1, 2] = 50_000.0
    path.write_bytes(imagecodecs.rgbe_encode(bright))
    # Eight bits below the largest channel of the pixel, so that no display curve can have been applied.
    error = np.abs(Environment.load(path).radiance - bright)
    assert np.all(error <= bright.max(axis=2, keepdims=True) / 128)


def test_radiance_hdr_rows_written_by_hand(tmp_path):
    """Uncompressed pixels, as the format defines them: mantissa / 256 * 2^(exponent - 128)."""
    pixels = np.array([[128, 64, 32, 129]] * 4 + [[0, 0, 0, 0]] * 4, np.uint8)  # 4 x 2, upper row lit
    path = tmp_path / "hand.hdr"
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + pixels.tobytes())
    expected = np.zeros((2, 4, 3))
    expected[0] = [1.0, 0.5, 0.25]
    np.testing.assert_array_equal(Environment.load(path).radiance, expected)


@pytest.mark.parametrize("shape", [(6, 6), (4, 3), (3, 5), (5, 1)])
def test_other_aspects_are_lat_long_with_a_warning(shape, tmp_path):
    image = _noise(*shape)
    path = _write_exr(tmp_path / "odd.exr", {"RGB": image})
    with pytest.warns(DataWarning, match=f"{shape[1]} x {shape[0]} is neither 2:1") as caught:
        light = Environment.load(path)
    assert len(caught) == 1
    np.testing.assert_array_equal(light.radiance, image)


# --- repairs ---


def test_defects_are_repaired_with_one_warning_that_counts_them(tmp_path):
    image = np.full((6, 12, 3), 2.0, np.float32)
    image[0, 0, 0] = 7.0
    image[3, 0] = np.nan
    image[1, 5, 1] = np.nan
    image[2, 8, 0] = np.inf
    image[4, 4] = -1.0
    image[5, 5, 2] = -np.inf
    with pytest.warns(DataWarning, match="2 NaN, 1 infinite, 2 negative") as caught:
        light = Environment.load(_write_exr(tmp_path / "bad.exr", {"RGB": image}))
    assert len(caught) == 1
    assert light.repaired == {"NaN": 2, "infinite": 1, "negative": 2}
    expected = np.full((6, 12, 3), 2.0)
    expected[0, 0, 0] = expected[2, 8, 0] = 7.0
    expected[4, 4] = expected[5, 5, 2] = expected[3, 0] = expected[1, 5, 1] = 0.0
    np.testing.assert_array_equal(light.radiance, expected)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert light.rotated(10.0).repaired == light.repaired  # no second warning
        assert np.isfinite(light.rotated(10.0).sh(10)).all()


def test_missing_pixels_become_black():
    image = np.full((5, 10, 3), np.nan)
    image[0, 0] = 3.0
    with pytest.warns(DataWarning, match="49 NaN"):
        light = Environment(image)
    assert light.radiance[3, 5].tolist() == [0.0, 0.0, 0.0] and light.radiance[0, 0].tolist() == [3.0] * 3


def test_values_beyond_single_precision_count_as_infinite():
    image = np.ones((2, 4, 3))
    image[0, 0] = 1e300
    with pytest.warns(DataWarning, match="1 infinite"):
        np.testing.assert_array_equal(Environment(image).radiance, 1.0)


# --- refusals ---


def _exr_bytes(tmp_path, height=64):
    return _write_exr(tmp_path / "whole.exr", {"RGB": _noise(height, 2 * height)}).read_bytes()


REFUSED = {
    "empty": (lambda _: b"", "is empty"),
    "png": (lambda _: b"\x89PNG\r\n\x1a\n" + bytes(50), "neither OpenEXR nor Radiance HDR"),
    "jpeg": (lambda _: b"\xff\xd8\xff\xe0" + bytes(50), "neither OpenEXR nor Radiance HDR"),
    "text": (lambda _: b"hello", "neither OpenEXR nor Radiance HDR"),
    "exr magic alone": (lambda _: b"\x76\x2f\x31\x01", "damaged OpenEXR"),
    "exr header cut": (lambda folder: _exr_bytes(folder)[:200], "damaged OpenEXR"),
    "exr pixels cut": (lambda folder: _exr_bytes(folder)[:-500], "damaged OpenEXR"),
    "hdr magic alone": (lambda _: b"#?", "damaged or unusual Radiance"),
    "hdr header cut": (lambda _: imagecodecs.rgbe_encode(IMAGE)[:30], "damaged or unusual Radiance"),
    "hdr pixels cut": (lambda _: imagecodecs.rgbe_encode(IMAGE)[:-9], "damaged or unusual Radiance"),
    "hdr of another kind": (lambda _: b"#?RADIANCE\nFORMAT=32-bit_rle_luv\n\n-Y 1 +X 2\n" + bytes(8), "unknown kind"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_unusable_files_are_refused_in_one_line(kind, tmp_path):
    content, message = REFUSED[kind]
    path = tmp_path / "bad.hdr"
    path.write_bytes(content(tmp_path))
    with pytest.raises(InputError, match=message) as error:
        Environment.load(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("kind", REFUSED)
def test_a_command_says_nothing_else_of_an_unusable_file(kind, tmp_path, capfd):
    path = tmp_path / "bad.hdr"
    path.write_bytes(REFUSED[kind][0](tmp_path))
    mesh = tmp_path / "mesh.ply"
    write_mesh_ply(mesh, Mesh(*(np.eye(3, dtype=np.float32),) * 2, np.int32([[0, 1, 2]]), np.zeros((3, 3), np.uint8)))
    assert cli.main([str(mesh), "--env", str(path), "-o", str(tmp_path / "out")]) == 2
    said = capfd.readouterr()
    assert said.out == "" and len(said.err.splitlines()) == 1  # the libraries' own complaints stay away


@pytest.mark.parametrize("channels", [{"Z": RED}, {"R": RED, "G": GREEN}, {"id": RED.astype(np.uint32)}])
def test_exr_without_color_is_refused_by_its_channels(channels, tmp_path):
    path = _write_exr(tmp_path / "depth.exr", channels)
    with pytest.raises(
        InputError, match="no colour: expected channels R, G and B.*found " + ", ".join(sorted(channels))
    ):
        Environment.load(path)


def test_unknown_name_lists_the_builtin_ones(tmp_path):
    with pytest.raises(InputError, match=r"stdio does not exist: .*studio, overcast, noon, sunset"):
        Environment.load("stdio")
    with pytest.raises(InputError, match=r"cannot read .*directory"):
        Environment.load(tmp_path)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_image_without_a_finite_pixel_is_refused(value, tmp_path):
    path = _write_exr(tmp_path / "void.exr", {"RGB": np.full((2, 4, 3), value, np.float32)})
    with pytest.raises(InputError, match=r"void\.exr: no pixel of the image is finite"):
        Environment.load(path)


@pytest.mark.parametrize("shape", [(4, 8), (4, 8, 4), (0, 8, 3), (3,)])
def test_arrays_of_another_shape_are_refused(shape):
    with pytest.raises(InputError, match=r"\(H, W, 3\) image, found shape"):
        Environment(np.ones(shape))
