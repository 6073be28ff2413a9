"""Requests and command lines: each option is a field, each field an option or known to be for Python only."""

import dataclasses
import json

import imagecodecs
import numpy as np
import pytest
from viewer_scenes import ball_on_plate

import relight.cli
import splat2mesh.cli
from relight import Environment, LightingOptions
from relight.jobs.folders import relight_files
from relight.request import RelightRequest
from splat2mesh.base.console import Display
from splat2mesh.base.errors import InputError
from splat2mesh.base.requests import option_names
from splat2mesh.options import ConvertOptions, TilingOptions

CALLS = {"help", "version", "completion", "plan", "plot", "tiles"}
"""Options that choose what is called, and are no setting of it."""

OF_INSERT = {"turn", "scale", "on"}
"""Options that are words of the field `inserted`."""

SESSION = {"view", "screenshot", "serve"}


def names_of(*requests):
    return {field.name for request in requests for field in dataclasses.fields(request)}


def test_each_option_of_splat2mesh_is_a_field_and_each_field_an_option():
    fields = names_of(ConvertOptions, TilingOptions, Display)
    options = set(option_names(splat2mesh.cli.parser()))
    assert options - CALLS - {"output", "overwrite", "info", "sequence", "fps"} == fields - {"tile_splats"}


def test_each_option_of_relight_is_a_field_and_each_field_an_option():
    fields = names_of(RelightRequest, LightingOptions, ConvertOptions, TilingOptions, Display)
    options = set(option_names(relight.cli.parser()))
    python_only = {"scene", "lighting", "meshing", "tiling", "tile_splats"}  # SCENE is no option, the others are nested
    python_only |= {"probe_at"}  # which --at fills
    assert options - CALLS - SESSION - OF_INSERT == fields - python_only


def test_no_parser_has_a_default_of_its_own():
    for parser in (relight.cli.parser(), splat2mesh.cli.parser()):
        said = vars(parser.parse_args(["INPUT"]))
        assert set(said) <= {"input", "scene"}


def test_a_command_without_options_asks_for_the_defaults():
    words = relight.cli.parser().parse_args(["garden"])
    asked, plain = relight.cli.request_of(words), RelightRequest("garden")
    assert dataclasses.asdict(asked) == dataclasses.asdict(plain)


def test_every_word_reaches_its_field():
    line = "garden --env noon --rotate 0:20:10 --lamps 0.5 --exposure 1 --albedo white --method raytraced"
    line += " --tolerance 3% --effects shadows --bands 4 --rays 32 --no-cache --seed 7 --fps 12 --up -z --vertices 20k"
    line += (
        " --memory 4 --format glb,npy --format live --sheet --live --harmonics keep --bake texture --texture-size 64"
    )
    line += " --splat a.ply --sky drop -o out --overwrite"
    words = relight.cli.parser().parse_args(line.split())
    asked = relight.cli.request_of(words)
    light = {"method": "raytraced", "tolerance": 0.03, "effects": "shadows", "bands": 4, "rays": 32, "seed": 7}
    expected = RelightRequest(
        "garden",
        "noon",
        LightingOptions(**light, lamps=0.5),
        angles_deg=(0.0, 10.0, 20.0),
        albedo="white",
        exposure_ev=1.0,
        formats=("glb", "npy", "live"),
        baked=("texture",),
        texture_size=64,
        sheet=True,
        sky="drop",
        live_mesh=True,
        harmonics="keep",
        splat="a.ply",
        fps=12.0,
        caching="none",
        meshing=ConvertOptions(up="-z", vertices=20_000),
        tiling=TilingOptions(memory=4.0),
        output="out",
        overwrite=True,
    )
    assert dataclasses.asdict(asked) == dataclasses.asdict(expected)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"formats": ["gif"]}, "`formats` gif: expected one of glb ply"),
        ({"baked": ["normals"]}, "`baked` normals: expected one of texture transfer"),
        ({"sky": "blue"}, "`sky` blue: expected one of new keep drop"),
        ({"harmonics": "all"}, "`harmonics` all: expected one of zero keep"),
        ({"caching": "some"}, "`caching` some: expected one of"),
        ({"exposure_ev": 65.0}, "`exposure_ev` 65.0: expected stops from -64 to 64"),
        ({"exposure_ev": float("nan")}, "`exposure_ev` nan"),
        ({"angles_deg": ()}, "`angles_deg`: 0 angles"),
        ({"live_mesh": True, "formats": ["npy"]}, "`live_mesh`: it belongs to the format glb"),
        ({"clear_cache": True, "caching": "none"}, "`clear_cache`: without a cache"),
        ({"animated": True, "angles_deg": (0.0, 1.0)}, "`angles_deg`: an animation has one angle"),
    ],
)
def test_fields_that_make_no_sense_are_refused_by_their_own_names(fields, message):
    with pytest.raises(InputError) as caught:
        RelightRequest("garden", **fields)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"vertices": 3}, "`vertices` 3: a mesh needs at least 4"),
        ({"max_chunk_vertices": 2}, "`max_chunk_vertices` 2: a chunk needs at least 3"),
        ({"up": "x"}, "`up` x: expected one of auto"),
        ({"detail": "best"}, "`detail` best"),
        ({"surface": "poisson"}, "`surface` poisson"),
        ({"background": "blur"}, "`background` blur"),
        ({"stand": "above"}, "`stand` above"),
        ({"proxy": "box"}, "`proxy` box"),
        ({"foliage": "hedge"}, "`foliage` hedge"),
        ({"lod": "high"}, "`lod` high"),
        ({"seed": -1}, "`seed` must be a whole number"),
        ({"eyes": [(0.0, float("inf"), 0.0)]}, "`eyes`"),
    ],
)
def test_so_are_those_of_a_mesh(fields, message):
    with pytest.raises(InputError) as caught:
        ConvertOptions(**fields)
    assert message in str(caught.value)


def test_loose_arguments_become_a_request():
    asked = RelightRequest.of("garden", "noon", "analytic", bands=3, albedo="white")
    assert asked.lighting == LightingOptions("analytic", bands=3) and asked.albedo == "white"
    changed = RelightRequest.of(asked, tolerance=0.1, sheet=True)
    assert changed.lighting == LightingOptions("analytic", bands=3, tolerance=0.1)
    assert changed.sheet and changed.albedo == "white" and changed.env == "noon"
    with pytest.raises(TypeError, match="lumens"):
        RelightRequest.of("garden", lumens=3)


def test_one_call_does_what_one_command_does(tmp_path, capsys):
    """Several lights, several angles and a sheet: the same files, to the byte, but for times in reports."""
    folder, lights = tmp_path / "ball", tmp_path / "lights"
    ball_on_plate().save(folder)
    lights.mkdir()
    for name in ("noon", "overcast"):
        radiance = Environment.load(name).radiance.astype(np.float32)
        (lights / f"{name}.hdr").write_bytes(imagecodecs.rgbe_encode(radiance))
    options = ["--env", str(lights), "--rotate", "0:90:90", "--format", "npy", "png", "--sheet", "--method", "analytic"]
    assert relight.cli.main([str(folder), *options, "-q", "-o", str(tmp_path / "a")]) == 0
    request = RelightRequest(
        folder,
        lights,
        LightingOptions("analytic"),
        angles_deg=(0.0, 90.0),
        formats=("npy", "png"),
        sheet=True,
        output=tmp_path / "b",
    )
    done = relight_files(request)
    assert len(done.folders) == 4 and done.sheet == tmp_path / "b" / "sheet.png"
    found = {path.relative_to(tmp_path / "b") for path in done.files}
    assert {"sheet.png", "noon_90/radiance.npy"} <= {path.as_posix() for path in found}
    for name in found:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    reports = [json.loads((tmp_path / side / "noon_90" / "report.json").read_text()) for side in "ab"]
    for report in reports:
        del report["seconds"], report["peak_mb"], report["rays_traced"]  # the second run finds them in the cache
    assert reports[0] == reports[1]
    radiance = np.load(tmp_path / "b" / "noon_90" / "radiance.npy")
    assert radiance.shape == (ball_on_plate().vertex_count, 3)
