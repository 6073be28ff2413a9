"""The ground under an object: the page's own code against the shadows of pictures, and the page itself."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, chromium
from live_scene import live_scene

from relight import Environment
from relight.live.bundle import described, write_bundle
from relight.live.ground import FILE, ShadowedGround
from relight.live.lights import light_of, rgbe
from relight.live.page import write_page
from relight.output.catcher import Catcher
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

ROOT = Path(__file__).parents[3]

SCRIPT = """
import { readFileSync, writeFileSync } from "node:fs";
const [web, folder, text] = process.argv.slice(1), wish = JSON.parse(text);
const { groundOf, arriving, groundShade } = await import(`${web}/ground.js`);
const { fromRgbe } = await import(`${web}/light.js`);
const read = (name) => new Uint8Array(readFileSync(`${folder}/${name}`));
try {
  const ground = groundOf(JSON.parse(readFileSync(`${folder}/ground.json`, "utf8")), read("ground.bin"));
  const light = arriving(ground, fromRgbe(read("light.rgbe")), wish.angle, wish.moved);
  writeFileSync(`${folder}/dark`, groundShade(ground, light, new Uint8Array(4 * ground.side ** 2)));
} catch (error) {
  console.log(error.message);
}
"""

in_node = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")

in_browser = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")

HIGH = np.array([0.6, 0.8, 0.0])  # a sun over +x: its shadows fall towards -x


@pytest.fixture(scope="module")
def catcher():
    """Of a pole on two feet: what it hides differs along x and z, and reaches far."""
    import open3d as o3d

    parts = [
        o3d.geometry.TriangleMesh.create_box(*size).translate(place)
        for size, place in (((0.2, 1.6, 0.2), (0, 0, 0)), ((0.2, 0.1, 0.7), (0, 0, 0)), ((0.5, 0.1, 0.2), (-0.4, 0, 0)))
    ]
    vertices = np.concatenate([np.asarray(part.vertices) for part in parts]).astype(np.float32)
    faces = np.concatenate([np.asarray(part.triangles) + 8 * i for i, part in enumerate(parts)]).astype(np.int32)
    scene = Scene.from_mesh(Mesh(vertices, np.zeros_like(vertices), faces, np.zeros((24, 3), np.uint8)))
    return Catcher(scene, RayCaster(scene.vertices, scene.faces))


def by_the_page(folder, catcher, environment, angle_deg=0.0, moved=()):
    """(S, S, 4) uint8 of the page's code; or what it says."""
    ground = catcher.ground()
    (folder / "ground.json").write_text(json.dumps(ground.described()))
    (folder / FILE).write_bytes(ground.tobytes())
    (folder / "light.rgbe").write_bytes(rgbe(light_of(environment, 1.0).image).tobytes())
    wish = json.dumps({"angle": np.radians(angle_deg), "moved": list(moved)})
    command = ["node", "--input-type=module", "-e", SCRIPT, ROOT / "relight/live/web", folder, wish]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    side = len(ground.steps)
    return done.stdout.strip() or np.fromfile(folder / "dark", np.uint8).reshape(side, side, 4)


def by_pictures(catcher, environment):
    """The same display factors by `Catcher.under`."""
    ground = catcher.ground()
    z, x = np.meshgrid(ground.steps, ground.steps, indexing="ij")
    points = ground.middle + ground.reach * np.stack([x, z], axis=-1).reshape(-1, 2)
    share = catcher.under(environment).share(points).reshape(*x.shape, 3)
    return 255.0 * (1.0 - share ** (1 / 2.4))


@in_node
@pytest.mark.parametrize(("name", "angle_deg"), [("overcast", 0.0), ("noon", 0.0), ("noon", 77.0), ("studio", 200.0)])
def test_the_page_shades_the_ground_as_pictures_do(tmp_path, catcher, name, angle_deg):
    """But for its image of the light, whose texels are 2.8 degrees wide."""
    environment = Environment.load(name)
    found = by_the_page(tmp_path, catcher, environment, angle_deg)
    expected = by_pictures(catcher, environment.rotated(angle_deg))
    assert expected.max() > 60
    assert np.sqrt(np.mean((found[..., :3] - expected) ** 2)) < 1.0
    assert np.abs(found[..., :3] - expected).max() < 12


@in_node
def test_the_rim_has_no_edge(tmp_path, catcher):
    found = by_the_page(tmp_path, catcher, Environment.load("noon"))
    edge = np.ones(found.shape[:2], bool)
    edge[1:-1, 1:-1] = False
    assert not found[edge].any()
    middle = found[len(found) // 2, :, 3].astype(int)
    assert middle.max() == 255
    assert np.abs(np.diff(middle)).max() < 2000 / len(found)


@in_node
def test_a_sun_that_moves_takes_its_shadow_along(tmp_path, catcher):
    """The sun of a light, taken out of its image, and another put in."""
    image = np.zeros((64, 128, 3), np.float32)
    image[:32] = 0.02
    even = Environment(image, name="even")
    middle = catcher.ground().steps

    def shadow_at(direction):
        moved = [{"direction": direction, "weight": [3.0, 3.0, 3.0]}]
        dark = by_the_page(tmp_path, catcher, even, 0.0, moved)[..., :3].mean(axis=2)
        far = dark * (np.hypot(*np.meshgrid(middle, middle)) > 0.15)
        return middle[np.unravel_index(far.argmax(), far.shape)[1]]

    assert shadow_at((HIGH * [1, 1, 1]).tolist()) < -0.1
    assert shadow_at((HIGH * [-1, 1, 1]).tolist()) > 0.1
    plain = by_the_page(tmp_path, catcher, even)
    sun = {"direction": HIGH.tolist(), "weight": [3.0] * 3}
    gone = by_the_page(tmp_path, catcher, even, 0.0, [sun, {**sun, "weight": [-3.0] * 3}])
    assert (gone == plain).all()


@in_node
def test_a_short_file_is_one_line(tmp_path, catcher):
    class Short:
        def ground(self):
            return Cut(*catcher.ground())

    class Cut(ShadowedGround):
        def described(self):
            return {**super().described(), "bytes": len(self.tobytes()) + 5}

    said = by_the_page(tmp_path, Short(), Environment.load("studio"))
    size = len(catcher.ground().tobytes())
    assert said == f"ground.bin holds {size} bytes, live.json says {size + 5}: export it again"


def ball_on_ground():
    relighter, _, _, live = live_scene()
    scene = relighter.scene
    return live._replace(ground=Catcher(scene, RayCaster(scene.vertices, scene.faces)).ground())


def test_only_objects_have_the_file(tmp_path):
    live = live_scene()[3]
    assert "ground" not in described(live, [])
    assert FILE not in write_bundle(tmp_path, live, exact=False)
    assert FILE in write_bundle(tmp_path, ball_on_ground(), exact=False)
    assert json.loads((tmp_path / "live.json").read_text())["ground"]["bytes"] == (tmp_path / FILE).stat().st_size


@in_browser
def test_the_page_shows_the_shadow_and_hides_it(tmp_path):
    frames = "new Promise((done) => { let n = 0; const f = () => ++n > 4 ? done() : requestAnimationFrame(f); f(); })"
    live = ball_on_ground()
    write_page(tmp_path, live)
    with Browser(f"file://{tmp_path}/relit.html#renderer=webgl&noui&nopanel", (320, 240)) as page:
        page.wait("window.relight && relight.drawn")

        def shown(**state):
            before = page.run("relight.drawn")
            page.run(f"relight.set({json.dumps(state)})")
            page.wait(f"relight.drawn > {before}")
            page.run(frames)
            return page.picture().astype(float)

        assert page.said == []
        for key in ("light", "turn"):
            assert page.run(f"relight.state.{key}") == 0
        bare = shown(light=1, ground=False)
        both = shown(ground=True)
        dark = bare.sum(axis=2) - both.sum(axis=2)
        assert dark.max() > 60 and dark.min() > -6
        assert page.run("document.getElementById('r-ground').hidden") is False
        turned = shown(turn=180)
        assert np.abs(turned - both)[dark > 30].mean() > 5
        disc = shown(turn=0, sky=False)
        assert np.abs(disc - shown(ground=False)).max(axis=2).mean() > 10
        for view in ("albedo", "captured"):
            assert (shown(view=view, ground=True) == shown(view=view, ground=False)).all()
        assert "ground=0" in page.run("new Promise((d) => setTimeout(() => d(location.hash), 500))")
        assert page.said == []
