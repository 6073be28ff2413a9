"""Files of relit splats: those of their source in all but the colours."""

from dataclasses import replace

import numpy as np
import pytest
from coloured_ball import ball_splats, irradiances, sphere_scene
from ply_samples import inria_columns, ply_bytes

from relight.output.joined_splats import append_splats
from relight.splats import Binding, write_relit_ply
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.facts import FileFacts
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.formats.inria import write_inria_ply
from splat2mesh.splats.formats.ply import Ply


def test_the_file_differs_from_its_source_in_colours_alone(tmp_path):
    scene, splats = sphere_scene(), ball_splats(2, 200)
    source, target = tmp_path / "source.ply", tmp_path / "relit_splat.ply"
    names = ["opacity", "rot_3", "rot_0", "rot_1", "rot_2", "z", "y", "x", "extra", "scale_0", "scale_1", "scale_2"]
    names += [f"f_dc_{i}" for i in range(3)] + [f"f_rest_{i}" for i in range(24)]
    rows = np.zeros(200, [(name, "<f4") for name in names])
    rng = np.random.default_rng(0)
    write_inria_ply(target, splats)
    plain = Ply.open(target).rows("vertex")
    for name in names:
        rows[name] = plain[name] if name in plain.dtype.names else rng.normal(size=200)
    for name in ("rot_0", "rot_1", "rot_2", "rot_3"):
        rows[name] *= 3.7  # of any length: must not come back normalised
    rows["x"][7], rows["opacity"][9], rows["rot_0"][4:6] = np.nan, np.inf, 0
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 200\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    source.write_bytes(header.encode() + rows.tobytes())
    read = read_splats(source)
    with pytest.warns(DataWarning, match="1 of 200"):
        result = Binding(read, scene).relit(*irradiances(scene))
    write_relit_ply(target, result, source)
    written = Ply.open(target).rows("vertex")
    kept = ["x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    for name in kept:
        assert written[name].tobytes() == rows[name].tobytes(), name
    assert list(written.dtype.names)[:9] == ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    np.testing.assert_array_equal(read_splats(target).sh, result.sh)
    assert written["f_dc_0"][7] == rows["f_dc_0"][7]
    assert (written["f_dc_0"] != rows["f_dc_0"]).sum() == 199


def test_the_source_of_other_splats_is_refused(tmp_path):
    splats = ball_splats(0, 30)
    write_inria_ply(tmp_path / "other.ply", splats)
    with pytest.raises(InputError, match="holds 30 splats, 20 are to be written"):
        write_relit_ply(tmp_path / "relit.ply", splats.take(slice(0, 20)), tmp_path / "other.ply")
    assert not (tmp_path / "relit.ply").exists()


def test_without_an_inria_source_the_file_is_the_standard_one(tmp_path):
    splats = ball_splats(1, 30)
    (tmp_path / "source.spz").write_bytes(b"NGSP something else")
    write_relit_ply(tmp_path / "a.ply", splats, tmp_path / "source.spz")
    write_inria_ply(tmp_path / "b.ply", splats)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_coordinates_in_double_and_tags_stay_as_they_are(tmp_path):
    splats = replace(ball_splats(1, 60), facts=FileFacts(True, (0.0, 0.0, 1.0), "x", offset=(5e5, 5.4e6, 302.0)))
    write_inria_ply(tmp_path / "source.ply", splats)
    read = read_splats(tmp_path / "source.ply")
    assert any(read.facts.offset) and read.facts.antialiased
    write_relit_ply(tmp_path / "relit.ply", replace(read, sh=read.sh * 0.5), tmp_path / "source.ply")
    before, after = (Ply.open(tmp_path / name).rows("vertex") for name in ("source.ply", "relit.ply"))
    for name in "xyz":
        assert after[name].dtype == np.float64
        np.testing.assert_array_equal(after[name], before[name])
    again = read_splats(tmp_path / "relit.ply")
    assert again.facts == read.facts
    np.testing.assert_array_equal(again.means, read.means)


def test_the_filter_of_mip_splatting_is_written_as_it_was_folded_in(tmp_path):
    splats = ball_splats(0, 40)
    columns = inria_columns(splats) | {"filter_3D": np.full(40, 0.05)}
    (tmp_path / "source.ply").write_bytes(ply_bytes(columns))
    read = read_splats(tmp_path / "source.ply")
    write_relit_ply(tmp_path / "relit.ply", read, tmp_path / "source.ply")
    again = read_splats(tmp_path / "relit.ply")
    np.testing.assert_allclose(again.scales, read.scales, rtol=1e-5)
    np.testing.assert_allclose(again.opacities, read.opacities, rtol=1e-5)
    assert (read.scales > splats.scales).all()


def test_objects_join_a_file_of_doubles_where_they_stand(tmp_path):
    place = replace(ball_splats(1, 30), facts=FileFacts(offset=(5e5, 5.4e6, 302.0)))
    write_inria_ply(tmp_path / "a.ply", place)
    append_splats(tmp_path / "a.ply", ball_splats(0, 20), place.facts)
    found = read_splats(tmp_path / "a.ply")
    assert len(found) == 50
    whole = found.means.astype(np.float64) + found.facts.offset
    expected = np.concatenate([place.means, ball_splats(0, 20).means]).astype(np.float64) + place.facts.offset
    np.testing.assert_allclose(whole, expected, atol=1e-6)
