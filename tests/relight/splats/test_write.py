"""Files of relit splats: those of their source in all but the colours."""

import numpy as np
import pytest
from coloured_ball import ball_splats, irradiances, sphere_scene

from relight.splats import relit, write_relit_ply
from splat2mesh.base.errors import DataWarning, InputError
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
        result = relit(read, scene, *irradiances(scene))
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
