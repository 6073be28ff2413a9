"""Radiance pictures: rows from above and below, run lengths, exposures; sizes before memory."""

import imagecodecs
import numpy as np
import pytest
from color_primaries import PRIMARIES, expected_matrix

from relight.light.environment_files import decode
from splat2mesh.base.errors import DataWarning, InputError

HEAD = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n"
IMAGE = np.random.default_rng(0).random((6, 16, 3), np.float32) * 5
WHOLE = imagecodecs.rgbe_encode(IMAGE)
SIZE = b"-Y 6 +X 16"


def test_the_usual_order_is_what_another_decoder_reads():
    np.testing.assert_array_equal(decode(WHOLE, "a"), imagecodecs.rgbe_decode(WHOLE))


def test_rows_from_below():
    found = decode(WHOLE.replace(SIZE, b"+Y 6 +X 16"), "a")
    np.testing.assert_array_equal(found, imagecodecs.rgbe_decode(WHOLE)[::-1])


def test_pixels_are_divided_by_all_exposures():
    changed = WHOLE.replace(b"\n\n", b"\nEXPOSURE=4\nEXPOSURE= 0.5\nCOLORCORR=1 2 4\n\n", 1)
    np.testing.assert_allclose(decode(changed, "a"), decode(WHOLE, "a") / [2.0, 4.0, 8.0], rtol=1e-6)


@pytest.mark.parametrize("space", ["Rec.709", "AP1", "Rec.2020", "XYZ"])
def test_primaries_are_converted_to_srgb(space):
    line = " ".join(f"{each:.5f}" for each in PRIMARIES[space])
    stored = imagecodecs.rgbe_encode((IMAGE @ expected_matrix(PRIMARIES[space]).T).astype(np.float32))
    whole = decode(stored.replace(b"\n\n", f"\nPRIMARIES= {line}\n\n".encode(), 1), "a")
    # Eight bits below the largest channel of a pixel, which the inverse of the widest space multiplies by three.
    assert (np.abs(whole - IMAGE) <= 3 / 128 * IMAGE.max(axis=2, keepdims=True)).all()
    if space == "Rec.709":
        np.testing.assert_array_equal(whole, imagecodecs.rgbe_decode(stored))
    if space == "XYZ":
        marked = stored.replace(b"32-bit_rle_rgbe", b"32-bit_rle_xyze", 1)
        np.testing.assert_allclose(decode(marked, "a"), whole, atol=1e-4)  # the line has five digits


def with_primaries(line):
    return decode(WHOLE.replace(b"\n\n", b"\nPRIMARIES=" + line + b"\n\n", 1), "a")


@pytest.mark.parametrize("line", [b"0 0 0 0 0 0 0 0", b""])  # Photoshop writes zeros
def test_primaries_that_are_not_stated_are_those_of_srgb(line):
    np.testing.assert_array_equal(with_primaries(line), decode(WHOLE, "a"))


@pytest.mark.parametrize("line", [b".3 .3 .3 .3 .3 .3 .3 .3", b"0.64 0.33"])
def test_primaries_that_span_nothing_are_ignored_with_a_warning(line):
    with pytest.warns(DataWarning, match="span no colours"):
        found = with_primaries(line)
    np.testing.assert_array_equal(found, decode(WHOLE, "a"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (HEAD + b"EXPOSURE=0\n\n-Y 1 +X 1\n" + bytes(4), "exposure"),
        (HEAD + b"EXPOSURE=much\n\n-Y 1 +X 1\n" + bytes(4), "EXPOSURE"),
        (HEAD + b"PRIMARIES=red\n\n-Y 1 +X 1\n" + bytes(4), "PRIMARIES"),
        (HEAD + b"\n-Y 1 +Y 1\n" + bytes(4), "no size"),
        (HEAD + b"\n+X 1 -Y 1\n" + bytes(4), "no size"),
        (HEAD + b"\n-Y 0 +X 4\n", "no size"),
        (HEAD + b"\n-Y 99999 +X 99999\n" + bytes(40), "announces 99999 x 99999 pixels"),
        (HEAD + b"\n-Y 1 +X 4\n" + bytes([1, 1, 1, 4]), "0 of 1 rows"),
        (HEAD + b"\n-Y 1 +X 4\n" + bytes([9, 9, 9, 9, 1, 1, 1, 4]), "0 of 1 rows"),
        (HEAD, "header has no end"),
    ],
)
def test_what_makes_no_sense_is_refused(content, message):
    with pytest.raises(InputError, match=message):
        decode(content, "a")
