"""relight.lamps.gltf_lights: files that pygltflib wrote, placed by hand."""

import io
import json
import struct

import numpy as np
import pygltflib as gltf
import pytest
from attacks import damaged
from PIL import Image
from typed_lamps import parse_lamp

from relight.lamps.asked import Brightness, LampScale, luminance, resolve
from relight.lamps.gltf_lights import PUNCTUAL, read_glow
from relight.lamps.photometry import axis_intensity, flux
from relight.lamps.shapes import MeshLamp, SphereLamp, SpotLamp
from relight.lamps.spec import read_lamps
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.glb import Glb

QUARTER = np.sqrt(0.5)
CORNERS = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def with_lights(path, lights, nodes):
    document = gltf.GLTF2(asset=gltf.Asset(version="2.0"), extensionsUsed=[PUNCTUAL])
    document.extensions = {PUNCTUAL: {"lights": lights}}
    document.nodes = [gltf.Node(**node) for node in nodes]
    children = {child for node in nodes for child in node.get("children", [])}
    document.scenes = [gltf.Scene(nodes=[index for index in range(len(nodes)) if index not in children])]
    document.scene = 0
    path.write_text(document.to_json())
    return path


def shows(light, **more):
    return {"extensions": {PUNCTUAL: {"light": light}}, **more}


def with_sign(path, strength=4.0, factor=(1.0, 0.5, 0.25), picture=None, node=None, **material):
    """A rectangle of 2 x 1 that faces +z and glows, and another that does not."""
    file = Glb(extensionsUsed=["KHR_materials_emissive_strength"])
    glowing = gltf.Material(emissiveFactor=list(factor), **material)
    glowing.extensions = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    file.document.materials = [glowing, gltf.Material()]
    attributes = {"POSITION": file.positions(CORNERS)}
    if picture is not None:
        packed = io.BytesIO()
        Image.fromarray(picture).save(packed, "PNG")
        file.document.images = [gltf.Image(bufferView=file.data(packed.getvalue()), mimeType="image/png")]
        file.document.textures = [gltf.Texture(source=0)]
        glowing.emissiveTexture = gltf.TextureInfo(index=0)
        attributes["TEXCOORD_0"] = file.values((CORNERS[:, :2] / [2, 1]).astype(np.float32))
    faces = file.indices(FACES, 4)
    file.mesh("sign", attributes, indices=faces, material=0)
    file.mesh("wall", {"POSITION": file.positions(CORNERS - [0, 0, 1])}, indices=faces, material=1)
    for name, value in (node or {}).items():
        setattr(file.document.nodes[0], name, value)
    file.save(path)
    return path


def test_a_point_is_where_its_nodes_put_it(tmp_path):
    light = {"type": "point", "color": [1.0, 0.5, 0.25], "intensity": 50.0, "range": 3.0, "name": "bulb"}
    nodes = [
        {"translation": [1.0, 0.0, 0.0], "rotation": [0.0, 0.0, QUARTER, QUARTER], "children": [1]},
        shows(0, translation=[2.0, 0.0, 0.0]),
    ]
    (asked,) = read_lamps(with_lights(tmp_path / "x.gltf", [light], nodes))
    assert isinstance(asked.shape, SphereLamp) and asked.shape.radius == 0.0 and asked.name == "bulb"
    assert asked.shape.position == pytest.approx((1.0, 2.0, 0.0), abs=1e-12)
    lamp = resolve(asked, LampScale(2.0, 1.0, 0.01))
    assert lamp.intensity == pytest.approx(50.0 * 0.01 * 4.0 * np.array([1.0, 0.5, 0.25]))


def test_a_spot_points_along_its_axis(tmp_path):
    cone = {"innerConeAngle": np.radians(20.0), "outerConeAngle": np.radians(25.0)}
    lights = [{"type": "spot", "intensity": 9.0, "spot": cone}, {"type": "spot", "spot": {}}]
    nodes = [shows(0, rotation=[-QUARTER, 0.0, 0.0, QUARTER], translation=[0.0, 2.0, 0.0]), shows(1, scale=[3.0] * 3)]
    down, ahead = read_lamps(with_lights(tmp_path / "x.gltf", lights, nodes))
    assert isinstance(down.shape, SpotLamp)
    assert np.subtract(down.shape.target, down.shape.position) == pytest.approx((0.0, -1.0, 0.0), abs=1e-12)
    assert (down.shape.cutoff_deg, down.shape.beam_deg) == pytest.approx((25.0, 20.0))
    assert down.brightness == Brightness(9.0, "candela") and down.color == pytest.approx((1.0, 1.0, 1.0))
    # What the specification says where a file says nothing.
    assert ahead.brightness == Brightness(1.0, "candela") and ahead.shape.target == (0.0, 0.0, -1.0)
    assert (ahead.shape.cutoff_deg, ahead.shape.beam_deg) == pytest.approx((45.0, 0.0))


def test_suns_are_counted_and_alone_are_no_lamps(tmp_path):
    lights = [{"type": "directional"}, {"type": "point"}]
    with pytest.warns(DataWarning, match="skipped 2 directional lights"):
        lamps = read_lamps(with_lights(tmp_path / "x.gltf", lights, [shows(0), shows(1), shows(0)]))
    assert len(lamps) == 1
    with pytest.warns(DataWarning, match="skipped 1 dir"), pytest.raises(InputError, match="holds no lamps"):
        read_lamps(with_lights(tmp_path / "y.gltf", lights, [shows(0)]))


def test_lights_outside_the_shown_scene_are_off(tmp_path):
    path = with_lights(tmp_path / "x.gltf", [{"type": "point"}], [shows(0), shows(0, translation=[1.0, 0.0, 0.0])])
    content = json.loads(path.read_text())
    content["scenes"][0]["nodes"] = [1]
    path.write_text(json.dumps(content))
    (lamp,) = read_lamps(path)
    assert lamp.shape.position == (1.0, 0.0, 0.0)


def test_a_sign_glows_as_the_file_says(tmp_path):
    turned = {"translation": [0.0, 0.0, 5.0], "rotation": [0.0, QUARTER, 0.0, QUARTER], "scale": [1.0, 2.0, 1.0]}
    (asked,) = read_lamps(with_sign(tmp_path / "sign.glb", node=turned))
    lamp = resolve(asked, LampScale(1.0, 1.0))
    assert isinstance(lamp, MeshLamp) and len(lamp.faces) == 2 and not lamp.two_sided and asked.name == "sign"
    # 2 x 2 after scaling, and +z turned to +x.
    assert axis_intensity(lamp) == pytest.approx(4.0 * 4.0 * np.array([1.0, 0.5, 0.25]), rel=1e-6)
    corners = lamp.vertices[lamp.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert normals == pytest.approx(np.array([[4.0, 0.0, 0.0]] * 2), abs=1e-6)
    assert lamp.vertices[:, 0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("mirror", [[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
def test_a_mirrored_sign_shines_to_the_same_side(tmp_path, mirror):
    lamp = read_glow(with_sign(tmp_path / "sign.glb", node={"scale": mirror})).shape
    corners = lamp.vertices[lamp.faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0).all()


def test_a_sign_as_bright_as_asked_for(tmp_path):
    path = with_sign(tmp_path / "sign.glb", doubleSided=True)
    asked = parse_lamp(f"{path} at=0,0,2 brightness=+3EV")
    lamp = resolve(asked, LampScale(1.0, 0.5))
    assert lamp.two_sided and luminance(axis_intensity(lamp)) == pytest.approx(4.0)
    assert lamp.vertices[:, 2] == pytest.approx(2.0)
    blue = resolve(parse_lamp(f"{path} color=blue"), LampScale(1.0, 0.5))
    assert luminance(flux(blue)) == pytest.approx(luminance(flux(read_glow(path).shape)))
    assert (blue.radiance[:, :2] == 0.0).all()


def test_pictures_count_as_their_mean_over_a_face(tmp_path):
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:, 32:] = [255, 188, 0]  # the right half; 188 in sRGB is half the light
    lamp = read_glow(with_sign(tmp_path / "sign.glb", factor=(1.0, 1.0, 1.0), strength=2.0, picture=picture)).shape
    assert len(lamp.faces) == 2
    # Of the lower right triangle three quarters glow, of the upper left one a quarter: 27 and 9 of 36 samples, give
    # or take those on the edge between.
    assert lamp.radiance[:, 0] / 2.0 == pytest.approx([0.75, 0.25], abs=0.09)
    assert lamp.radiance[:, 1] / lamp.radiance[:, 0] == pytest.approx(0.5, abs=0.005)
    assert (lamp.radiance[:, 2] == 0.0).all()
    with pytest.raises(InputError, match="black textures"):
        read_glow(with_sign(tmp_path / "black.glb", picture=np.zeros((4, 4, 3), np.uint8)))


def test_a_mesh_that_does_not_glow_is_no_lamp(tmp_path):
    with pytest.raises(InputError, match="holds no lamps"):
        read_lamps(with_sign(tmp_path / "sign.glb", factor=(0.0, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("light", "node", "says"),
    [
        ({"type": "area"}, {}, "type area"),
        ({"type": "point", "intensity": -1.0}, {}, "`brightness` -1"),
        ({"type": "point", "intensity": "x"}, {}, "damaged"),
        ({"type": "point", "color": [1.0]}, {}, "damaged"),
        ({"type": "spot"}, {"scale": [0.0, 0.0, 0.0]}, "has no direction"),
        ({"type": "spot", "spot": {"outerConeAngle": 9.0}}, {}, "`cutoff_deg`"),
        ({"type": "point"}, {"translation": [1e400, 0.0, 0.0]}, "damaged"),
    ],
)
def test_lights_that_make_no_sense_are_refused_in_one_line(tmp_path, light, node, says):
    with pytest.raises(InputError) as caught:
        read_lamps(with_lights(tmp_path / "x.gltf", [light], [shows(0, **node)]))
    assert "\n" not in str(caught.value) and (says in str(caught.value) or "position" in str(caught.value))


def test_a_light_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="it names entry 3 of 1"):
        read_lamps(with_lights(tmp_path / "x.gltf", [{"type": "point"}], [shows(3)]))


def test_large_pictures_are_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("splat2mesh.scene.gltftextures.MOST_TEXELS", 63)
    with pytest.raises(InputError, match="over 63 pixels"):
        read_glow(with_sign(tmp_path / "sign.glb", picture=np.full((8, 8, 3), 255, np.uint8)))


def test_truncated_and_damaged_files(tmp_path):
    whole = with_sign(tmp_path / "sign.glb", picture=np.full((8, 8, 3), 255, np.uint8)).read_bytes()
    rng = np.random.default_rng(3)
    header = struct.unpack_from("<I", whole, 12)[0] + 20
    contents = [whole[:end] for end in (3, 11, 19, header, len(whole) - 40)]
    contents += [damaged(whole, rng)[0] for _ in range(80)]
    for content in contents:
        path = tmp_path / "damaged.glb"
        path.write_bytes(content)
        try:
            assert len(read_lamps(path)) == 1
        except InputError as error:
            assert "\n" not in str(error)
        except DataWarning:
            pass
