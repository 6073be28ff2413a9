"""mkkellogg's .ksplat: every level, buckets, sections, harmonics; sizes are checked."""

import struct

import numpy as np
import pytest
from scan_samples import ksplat_bytes
from splat_samples import make_splats, store

from splat2mesh.base.errors import InputError
from splat2mesh.splats.formats import kind_of, read_splats


def samples(n, degree):
    splats = make_splats(n, degree)
    object.__setattr__(splats, "sh", (splats.sh / 2).clip(-1.9, 1.9))
    splats.sh[:, 0] = splats.sh[:, 0].clip(-1.7, 1.7)
    return splats


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("level", range(3))
@pytest.mark.parametrize("sections", [1, 3])
def test_every_level_degree_and_number_of_sections(tmp_path, level, degree, sections):
    splats = samples(700, degree)
    path = store(tmp_path, "a.ksplat", ksplat_bytes(splats, level, bucket=64, block=12.0, sections=sections))
    assert kind_of(path) == "ksplat"
    found = read_splats(path)
    # Half a step of 16 bits over the block of 12; half floats have 11 bits; bytes over 4 for level 2.
    np.testing.assert_allclose(found.means, splats.means, atol=0 if level == 0 else 0.51 * 12 / 65534)
    np.testing.assert_allclose(found.scales, splats.scales, rtol=0 if level == 0 else 5e-4)
    np.testing.assert_allclose(found.quats_wxyz, splats.quats_wxyz, atol=0 if level == 0 else 1e-3)
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=0.51 / 255)
    np.testing.assert_allclose(found.colors_diffuse, splats.colors_diffuse, atol=0.51 / 255)
    step = (1e-7, 1e-3, 0.51 * 4 / 255)[level]
    np.testing.assert_allclose(found.sh[:, 1:], splats.sh[:, 1:], atol=step)


def test_damaged_and_foreign_ones_get_one_line(tmp_path):
    data = ksplat_bytes(samples(300, 1), 1, bucket=64)

    def changed(at, form, *values):
        copy = bytearray(data)
        struct.pack_into(form, copy, at, *values)
        return bytes(copy)

    for broken, message in (
        (data[:100], "begins with 4096 bytes"),
        (data[:5000], "headers of sections end|is cut short"),
        (data[:-1], "is cut short: a section ends"),
        (changed(0, "<BB", 1, 0), "not a .ksplat of version 0.1"),
        (changed(4, "<I", 0xFFFFFFFF), "not a .ksplat of version 0.1"),
        (changed(4, "<I", 60000), "is cut short: 60000 headers"),
        (changed(16, "<I", 299), "counts 299 splats, its sections hold 300"),
        (changed(20, "<H", 7), "not a .ksplat of version 0.1"),
        (changed(36, "<f", np.nan), "bounds of its harmonics are not finite"),
        (changed(4096, "<I", 301), "is cut short"),
        (changed(4096 + 4, "<I", 0xFFFFFFFF), "is cut short"),
        (changed(4096 + 8, "<I", 1), "buckets hold fewer splats"),
        (changed(4096 + 12, "<I", 0xFFFFFFFF), "is cut short"),
        (changed(4096 + 20, "<H", 8), "buckets do not fit"),
        (changed(4096 + 36, "<I", 0xFFFFFFFF), "is cut short"),
        (changed(4096 + 40, "<H", 9), "harmonics of degree 9"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            read_splats(store(tmp_path, "a.ksplat", broken))
        assert "\n" not in str(caught.value)
