"""LCC scenes of XGRIDS: levels, units, harmonics, the environment, the frame; sizes are checked."""

import json
import struct
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scan_samples import write_lcc
from splat_samples import make_splats

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.sources import fingerprint
from splat2mesh.splats.formats import parts_of, read_splats, streamed

Z_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])


def samples(n, degree, seed=0):
    splats = make_splats(n, degree, seed)
    splats.sh[:, 0] = splats.sh[:, 0].clip(-1.7, 1.7)
    return replace(splats, sh=splats.sh.clip(-0.95, 0.95))


def assert_close(found, splats):
    """Up to the quantisation: float32, bytes, 16 bits over less than 2, 10 bits for rotations."""
    np.testing.assert_allclose(found.means, splats.means @ Z_UP.T, atol=1e-6)
    np.testing.assert_allclose(found.scales, splats.scales, atol=0.51 * 2 / 65535)
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=0.51 / 255)
    np.testing.assert_allclose(found.colors_diffuse, splats.colors_diffuse, atol=0.51 / 255)
    shape = Z_UP @ splats.covariances() @ Z_UP.T
    largest = (splats.scales.max(axis=1) ** 2)[:, None, None]
    # A component is off by 1/(2 * 1023 * 0.7) = 7e-4, an entry of R S R^T by some six times that.
    np.testing.assert_allclose(found.covariances() / largest, shape / largest, atol=0.006)
    for eye in np.eye(3):
        # Of 15 coefficients half a step of 4/1023 each.
        np.testing.assert_allclose(found.colors_toward(Z_UP @ eye), splats.colors_toward(eye), atol=0.02)


@pytest.mark.parametrize("degree", [0, 3])
def test_a_level_is_read_in_the_frame_of_a_ply(tmp_path, degree):
    levels = [samples(90, degree, 1), samples(31, degree, 2)]
    path = write_lcc(tmp_path / "scene", levels)
    for lod, expected in (("auto", 0), (0, 0), (1, 1), ("1", 1)):
        found = read_splats(path, lod)
        assert_close(found, levels[expected])
        assert found.facts.up == (0, -1, 0) and found.environment is None
    assert len(read_splats(tmp_path / "scene")) == 90
    with pytest.raises(InputError, match=r"`lod` 2: .* has the levels 0 \(90 splats\), 1 \(31 splats\)"):
        read_splats(path, 2)


@pytest.mark.parametrize("degree", [0, 3])
def test_the_environment_comes_last_and_is_marked(tmp_path, degree):
    near, far = samples(40, degree, 1), samples(12, degree, 2)
    found = read_splats(write_lcc(tmp_path / "scene", [near], far))
    assert found.environment.tolist() == [False] * 40 + [True] * 12
    assert_close(found.take(slice(40, None)), replace(far, environment=np.ones(12, bool)))


def test_auto_takes_the_finest_within_the_budget_and_says_so(tmp_path, monkeypatch):
    path = write_lcc(tmp_path / "scene", [samples(90, 0), samples(31, 0)])
    monkeypatch.setattr(streamed, "SPLAT_BUDGET", 50)
    with pytest.warns(DataWarning, match="took level 1 with 31 splats; level 0 holds 90"):
        assert len(read_splats(path)) == 31


def test_every_file_of_a_scene_counts_in_its_fingerprint(tmp_path):
    path = write_lcc(tmp_path / "scene", [samples(30, 3)], samples(5, 3))
    assert len(parts_of(path).files) == 5
    before = fingerprint(path)
    for name in ("meta.lcc", "index.bin", "data.bin", "shcoef.bin", "environment.bin"):
        data = (tmp_path / "scene" / name).read_bytes()
        (tmp_path / "scene" / name).write_bytes(data + b" " if name == "meta.lcc" else data[:-1] + b"\7")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            assert fingerprint(path) != before
        (tmp_path / "scene" / name).write_bytes(data)
    assert fingerprint(path) == before


def test_names_that_begin_with_a_capital(tmp_path):
    path = write_lcc(tmp_path / "scene", [samples(30, 3)])
    for name in ("index.bin", "data.bin", "shcoef.bin"):
        (tmp_path / "scene" / name).rename(tmp_path / "scene" / name.capitalize())
    assert len(read_splats(path)) == 30


def test_broken_scenes_get_one_line(tmp_path):
    folder = tmp_path / "scene"
    path = write_lcc(folder, [samples(30, 3), samples(9, 3)], samples(5, 3))
    whole = {each.name: each.read_bytes() for each in folder.iterdir()}
    meta = json.loads(whole["meta.lcc"])

    def index(number, form, at, value):
        copy = bytearray(whole["index.bin"])
        struct.pack_into(form, copy, number * (4 + 2 * 16) + at, value)
        return bytes(copy)

    for name, data, message in (
        ("index.bin", None, r"index\.bin: no such file, expected a part of meta\.lcc"),
        ("data.bin", None, r"data\.bin: no such file"),
        ("shcoef.bin", None, r"shcoef\.bin: no such file"),
        ("index.bin", whole["index.bin"][:-1], r"expected a multiple of 36"),
        ("index.bin", b"", r"expected a multiple of 36"),
        ("data.bin", whole["data.bin"][:-1], "is cut short"),
        ("shcoef.bin", whole["shcoef.bin"][:-1], r"shcoef\.bin is cut short"),
        ("environment.bin", whole["environment.bin"][:-1], r"expected a multiple of 96"),
        ("index.bin", index(0, "<i", 4, -1), r"holds \[|is cut short"),
        ("index.bin", index(0, "<i", 4, 0x7FFFFFFF), r"holds \["),
        ("index.bin", index(0, "<q", 8, 1 << 62), "names splats beyond"),
        ("index.bin", index(1, "<q", 8, 7), "begins within a splat"),
        ("meta.lcc", b"{ not json", "not valid JSON"),
        ("meta.lcc", b"[]", "not a splat file|does not describe an LCC scene"),
        ("meta.lcc", json.dumps(meta | {"totalLevel": 1 << 40}).encode(), "totalLevel must be"),
        ("meta.lcc", json.dumps(meta | {"attributes": []}).encode(), "lacks the bounds of scale"),
        ("meta.lcc", json.dumps(meta | {"splats": [30, 8]}).encode(), r"its splats are \[30, 8\] by level"),
    ):
        if data is None:
            (folder / name).unlink()
        else:
            (folder / name).write_bytes(data)
        with pytest.raises(InputError, match=message) as caught:
            read_splats(path)
        assert "\n" not in str(caught.value)
        (folder / name).write_bytes(whole[name])
    assert len(read_splats(path)) == 35
