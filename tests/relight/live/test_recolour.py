"""The passes on the graphics card light splats as the processor does, whose light tests compare with docs/live.md."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, chromium
from live_bundles import make_bundle
from splat_samples import make_splats

from relight.live.bundle import proxy_glb
from relight.live.page import script_of

HARNESS = "recolour_alone.js"

KINDS = {"webgl2": (), "webgpu": ("--enable-unsafe-webgpu", "--disable-gpu-sandbox")}
"""Flags of Chromium for a device without a graphics card."""

pytestmark = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")


def compared(folder, meta, kind):
    """What the harness finds of a bundle."""
    files = {each.name: each for each in folder.glob("*.*")} | {
        light["file"]: folder / light["file"] for light in meta["lights"]
    }
    packed = {name: base64.b64encode(path.read_bytes()).decode() for name, path in files.items()}
    harness = (Path(__file__).parents[2] / "support" / HARNESS).read_text("utf-8")
    script = script_of().replace("\nstart();\n", "\n" + harness)
    before = f"const META = {json.dumps(meta)}, FILES = {json.dumps(packed)}, KIND = '{kind}';"
    (folder / "alone.html").write_text(f"<body><script>{before}</script><script type=module>{script}</script>", "utf-8")
    with Browser(f"file://{folder}/alone.html", (320, 240), KINDS[kind]) as browser:
        if kind == "webgpu" and not browser.run("navigator.gpu?.requestAdapter().then(Boolean) ?? false"):
            pytest.skip("this Chromium has no WebGPU")
        browser.wait("window.results")
        return browser.run("results"), browser.said


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("weights", "more"), [(2, ""), (6, "lamps"), (14, "parts")])
def test_every_splat_has_the_gain_that_the_processor_gives_it(tmp_path, kind, weights, more):
    """Surfaces, leaves, sky, suns and their shadows, lamps, parts, tint, white. A step of a gain is a 1,024th; where an
    edge of a shadow runs through a texel, the two may differ more."""
    lamps = more == "lamps"
    meta, splats, kinds = make_bundle(tmp_path, 3000, weights=weights, splats=make_splats(3000, 0), lamps=lamps)
    assert set(kinds) == {0, 1, 2}
    frame = np.array(meta["frame"]["scene_from_splat"])
    places = splats.means @ frame[:3, :3].T + frame[:3, 3]
    rng = np.random.default_rng(0)
    corners = rng.choice(places, 60)[:, None] + 0.2 * places.std() * rng.normal(size=(60, 3, 3))
    triangles = corners.reshape(-1, 3).astype(np.float32), np.arange(180).reshape(-1, 3)
    (tmp_path / "proxy.glb").write_bytes(proxy_glb(*triangles))
    if more == "parts":
        members = np.stack([np.arange(3000) % 3, rng.integers(0, 256, 3000)], axis=1).astype(np.uint8)
        (tmp_path / "parts.bin").write_bytes(members.tobytes())
        meta["parts"] = [{"name": name, "exposure": 0, "tint": [1, 1, 1]} for name in "ab"]
    if not lamps:
        meta["lights"][1]["suns"] *= 2  # of which one moves aside
        meta["lights"][1]["suns"][1] = {"direction": [0.6, 0.8, 0.0], "weight": [0.5, 1.0, 2.0]}
    results, said = compared(tmp_path, meta, kind)
    assert not said and len(results) == 8
    for each in results:
        assert each["name"].startswith(kind) and each["share"] < 2e-3, each
        assert each["spread"] > (1 if "captured" in each["name"] else 50)
    plain = [each for each in results if "albedo" in each["name"] or "captured" in each["name"]]
    assert max(each["most"] for each in plain) <= 1
