"""The captured light set by hand on the page: the page's own code, run by node and by a browser, against Python."""

import base64
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, chromium
from live_scene import live_scene

from relight import Environment
from relight.albedo.by_hand import SkyAndSun, angles
from relight.light import SUN_TOLERANCE
from relight.light.captured_light import LikelyLight, LikelySun, known_light
from relight.light.sun_split import split
from relight.live.bundle import described, offered_files
from relight.live.lights import OfferedLight, rgbe
from relight.live.page import write_page
from relight.live.response import BANDS, SPREAD_BANDS, about_y

WEB = Path(__file__).parents[3] / "relight/live/web"

NODE = """
const [web, wish] = process.argv.slice(1), Hand = await import(web + "/hand.js");
const { entry, image, hand, factors } = JSON.parse(wish);
const [offered] = Hand.offeredOf([entry], [Buffer.from(image, "base64")]), light = Hand.lightByHand(offered, hand);
const hdr = Buffer.from(Hand.writeHdr(Hand.imageByHand(offered, hand, factors))).toString("base64");
const chosen = Hand.chosenLight(offered, hand, factors, "captured_light.hdr");
console.log(JSON.stringify({ whole: Array.from(light.whole), suns: light.suns, hdr, chosen }));
"""


@pytest.fixture(scope="module")
def offered():
    """The sky of noon with its sun, as an estimate would offer it."""
    environment = Environment.load("noon")
    toward = angles(split(environment, BANDS, SUN_TOLERANCE, 1)[1].directions[0])
    sun = LikelySun(toward["azimuth_deg"], toward["height_deg"], (1.0, 1.0, 1.0))
    return SkyAndSun.of(LikelyLight("noon", 0.8, sun, ""), environment)


def by_node(offered, hand, factors=(1.0, 1.0, 1.0)):
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    light = OfferedLight.of(offered)
    wish = {"entry": light.described("0.rgbe"), "image": base64.b64encode(rgbe(light.image).tobytes()).decode()}
    wish["hand"] = {"azimuth": hand.azimuth_deg, "height": hand.height_deg, "share": hand.sun_share}
    command = ["node", "--input-type=module", "-e", NODE, str(WEB), json.dumps(wish | {"factors": list(factors)})]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout)


@pytest.mark.parametrize(
    "change", [{}, {"azimuth_deg": 20.0, "height_deg": 25.0}, {"sun_share": 0.2}, {"sun_share": 0.0}]
)
def test_the_page_moves_the_sun_as_python_does(offered, change):
    hand = offered.hand.changed(**change)
    found = by_node(offered, hand)
    wanted = about_y(offered.coefficients(hand, BANDS))
    whole = np.reshape(found["whole"], (-1, 3))
    scale = np.abs(wanted).max()  # the page's image has a fourth of the texels, and bytes: 2% of its irradiance
    np.testing.assert_allclose(whole, wanted[: SPREAD_BANDS**2], atol=0.02 * scale)
    assert len(found["suns"]) == (hand.sun_share > 0.0)
    for sun in found["suns"]:
        np.testing.assert_allclose(sun["direction"], hand.direction, atol=1e-6)
        np.testing.assert_allclose(sun["weight"], offered.parts(hand)[1], rtol=0.02)


def test_commands_take_the_light_that_the_page_saves(offered, tmp_path):
    hand = offered.hand.changed(azimuth_deg=100.0, height_deg=30.0)
    factors = np.array([1.5, 1.2, 1.0])
    found = by_node(offered, hand, factors)
    (tmp_path / "captured_light.hdr").write_bytes(base64.b64decode(found["hdr"]))
    (tmp_path / "captured_light.json").write_text(json.dumps(found["chosen"]))
    light = known_light(tmp_path / "captured_light.json", None)
    assert light is not None and light.exposed and light.name == "set by hand from noon"
    wanted = offered.environment(hand)
    ours, theirs = light.sh(3), wanted.sh(3) * factors
    np.testing.assert_allclose(ours, theirs, atol=0.03 * np.abs(theirs).max())  # mantissas of 8 bits, wider texels


@pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
def test_albedo_and_relit_are_divided_by_what_the_light_set_by_hand_gives(offered, tmp_path):
    live = live_scene()[3]._replace(offered=[OfferedLight.of(offered)])
    assert described(live, [])["offered"][0]["file"] == offered_files(live)[0]
    write_page(tmp_path, live)
    with Browser(f"file://{tmp_path}/relit.html#renderer=webgl&noui&processor", (480, 480)) as page:
        page.wait("window.relight && relight.drawn")
        assert page.said == []
        before = np.array(page.run("Array.from(relight.ratio)"))
        drawn = page.run("relight.drawn")
        page.run("relight.set({ day: 1, dayAzimuth: 30, dayHeight: 40 })")
        page.wait(f"relight.drawn > {drawn}")
        after, given = (np.array(page.run(f"Array.from(relight.{each})")) for each in ("ratio", "received"))
        np.testing.assert_allclose(after * np.maximum(given, 0.1), before, rtol=1e-4, atol=1e-5)
        assert given.std() > 0.1 * given.mean()
        usual = np.array(page.run("relight.usually([1, 1, 1])"))  # of the whole scene, suns as harmonics
        np.testing.assert_allclose(usual, 1.0 / given.reshape(-1, 3).mean(axis=0), rtol=0.1)
        drawn = page.run("relight.drawn")
        page.run("relight.set({ bright: 1 })")
        page.wait(f"relight.drawn > {drawn}")
        np.testing.assert_allclose(np.array(page.run("Array.from(relight.ratio)")), after / 2, rtol=1e-4, atol=1e-6)
        assert page.run("document.getElementById('r-dayHeight').value") == "40"
        assert json.loads(page.run("new TextDecoder().decode(relight.handFiles()['captured_light.json'])"))["chosen"][
            "by_hand"
        ]
