"""SOG out: the reader, which other writers' files are tested with, finds the splats again."""

from dataclasses import replace

import numpy as np
import pytest
from sog_samples import store_folder
from splat_samples import assert_same, make_splats

from splat2mesh.base.errors import DataWarning
from splat2mesh.splats.formats import can_hold, kind_of, read_splats, write_splats
from splat2mesh.splats.formats.sog_writing import sog_files


@pytest.mark.parametrize("count", (1, 5, 3000))
def test_what_is_written_is_read_again_to_its_quantisation(tmp_path, count):
    splats = make_splats(count, 0)
    found = read_splats(store_folder(tmp_path, sog_files(splats)))
    span = np.ptp(np.log1p(np.abs(splats.means)), axis=0).max() * 2
    reach = 1 + np.abs(splats.means).max()
    np.testing.assert_allclose(found.means, splats.means, atol=reach * span / 65535 + 1e-6)
    step = np.ptp(np.log(splats.scales)) / 128  # half of the entries are spread by distance
    np.testing.assert_allclose(np.log(found.scales), np.log(splats.scales), atol=step + 1e-5)
    np.testing.assert_allclose(found.sh, splats.sh, atol=np.ptp(splats.sh) / 128 + 1e-5)
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=0.5 / 255 + 1e-6)
    same = np.abs((found.quats_wxyz * splats.quats_wxyz).sum(axis=1))
    assert same.min() > np.cos(0.01)


def test_the_bytes_are_the_same_again():
    assert sog_files(make_splats(500, 0)) == sog_files(make_splats(500, 0))


def test_what_it_cannot_hold_is_reported(tmp_path):
    with pytest.warns(DataWarning, match="harmonics of 20 splats"):
        sog_files(make_splats(20, 2))
    splats = make_splats(20, 0)
    broken = splats.means.copy()
    broken[3] = np.nan
    with pytest.warns(DataWarning, match="1 of 20"):
        files = sog_files(replace(splats, means=broken))
    assert read_splats(store_folder(tmp_path, files)).opacities[3] == 0.0


def test_one_file_holds_the_same_as_the_folder(tmp_path):
    splats = make_splats(400, 0)
    write_splats(tmp_path / "a.sog", splats, "sog")
    assert kind_of(tmp_path / "a.sog") == "sog"
    assert_same(read_splats(tmp_path / "a.sog"), read_splats(store_folder(tmp_path, sog_files(splats))))
    before = (tmp_path / "a.sog").read_bytes()
    write_splats(tmp_path / "a.sog", splats, "sog")
    assert (tmp_path / "a.sog").read_bytes() == before
    assert can_hold("sog", splats) and not can_hold("sog", make_splats(20, 1)) and can_hold("spz", make_splats(20, 1))
