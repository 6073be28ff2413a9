"""PlayCanvas SOG, both versions, from images encoded here."""

import io
import json
import zipfile

import imagecodecs
import numpy as np
import pytest
from PIL import Image
from sog_samples import palette_splats, sog_parts, store_folder, webp
from splat_samples import assert_same

from splat2mesh.base.errors import InputError
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.formats.sog import _pixels


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("version", [1, 2])
def test_sog_is_right_to_its_quantisation(tmp_path, version, degree):
    splats = palette_splats(300, degree)
    found = read_splats(store_folder(tmp_path, sog_parts(splats, version)))
    # Half a level over each range: 16 bits for the means (times |x| + 1 <= 6 for the logarithm), else 8.
    np.testing.assert_allclose(found.means, splats.means, atol=0.51 * 4 / 65535 * 6)
    np.testing.assert_allclose(np.log(found.scales), np.log(splats.scales), atol=0.51 * 8 / 255)
    np.testing.assert_allclose(found.sh, splats.sh, atol=0.51 * 8 / 255)
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=0.51 * 4.4 / 255 / (4 if version == 1 else 4.4))
    np.testing.assert_allclose(found.rotation_matrices(), splats.rotation_matrices(), atol=0.02)
    assert found.degree == degree


def test_sog_folder_meta_and_zip_are_one(tmp_path):
    parts = sog_parts(palette_splats(100, 1), 2)
    folder = store_folder(tmp_path, parts)
    expected = read_splats(folder)
    assert_same(read_splats(folder / "meta.json"), expected)
    for prefix in ("", "scene/"):
        with zipfile.ZipFile(tmp_path / "a.sog", "w") as bundle:
            for name, data in parts.items():
                bundle.writestr(prefix + name, data)
        assert_same(read_splats(tmp_path / "a.sog"), expected)


def test_sog_codebook_whose_first_entry_was_lost(tmp_path):
    splats = palette_splats(100, 0)
    parts = sog_parts(splats, 2)
    meta = json.loads(parts["meta.json"])
    meta["scales"]["codebook"][0] = None
    found = read_splats(store_folder(tmp_path, parts | {"meta.json": json.dumps(meta).encode()}))
    step = np.diff(meta["scales"]["codebook"][1:3])[0]
    # The lost entry is extrapolated by the mean step of the others: half a step of rounding, 1/255 more.
    np.testing.assert_allclose(np.log(found.scales), np.log(splats.scales), atol=0.52 * step)


def test_damaged_sogs(tmp_path):
    parts = sog_parts(palette_splats(100, 1), 2)
    meta = json.loads(parts["meta.json"])
    small = webp(np.zeros((4, 3)), (2, 2))
    tags = webp(np.column_stack([np.zeros((100, 3)), np.full(100, 9)]), (10, 10))
    labels = webp(np.full((100, 3), 255), (10, 10))

    def edited(**changes):
        return {"meta.json": json.dumps(meta | changes).encode()}

    for changes, message in [
        ({"sh0.webp": b"RIFF but no image"}, r"sh0\.webp is not a readable WebP"),
        ({"scales.webp": small}, r"scales\.webp has 4 pixels"),
        ({"quats.webp": tags}, "100 quaternions carry no valid mark"),
        ({"shN_labels.webp": labels}, "uses entry 65535 of the shN palette"),
        ({"shN_centroids.webp": small}, "2 pixels wide"),
        (edited(count=0), "holds no splats"),
        (edited(count=1 << 40), "announces 1,099,511,627,776 splats"),
        (edited(scales={"files": ["scales.webp"]}), "does not describe a SOG.*mins"),
        (edited(quats={"files": []}), "does not describe a SOG"),
    ]:
        with pytest.raises(InputError, match=message):
            read_splats(store_folder(tmp_path, parts | changes))
    store_folder(tmp_path, parts)
    (tmp_path / "quats.webp").unlink()
    with pytest.raises(InputError, match=r"quats\.webp is missing"):
        read_splats(tmp_path)
    with zipfile.ZipFile(tmp_path / "a.sog", "w") as bundle:
        for name in parts.keys() - {"quats.webp"}:
            bundle.writestr(name, parts[name])
    with pytest.raises(InputError, match=r"lacks quats\.webp"):
        read_splats(tmp_path / "a.sog")
    with zipfile.ZipFile(tmp_path / "b.sog", "w") as bundle:
        bundle.writestr("readme.txt", "nothing")
    with pytest.raises(InputError, match=r"zip without meta\.json"):
        read_splats(tmp_path / "b.sog")


def test_webp_images_keep_colours_under_no_alpha_and_animations_are_refused(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (40, 60, 4), dtype=np.uint8)
    pixels[::2, :, 3] = 0
    for values in (pixels, np.ascontiguousarray(pixels[..., :3])):
        data = imagecodecs.webp_encode(values, lossless=True)
        np.testing.assert_array_equal(_pixels(data), imagecodecs.webp_decode(data, hasalpha=True))
    np.testing.assert_array_equal(_pixels(imagecodecs.webp_encode(pixels, lossless=True)), pixels)
    file = io.BytesIO()
    frames = [Image.fromarray(each) for each in (pixels, 255 - pixels)]
    frames[0].save(file, "WEBP", save_all=True, append_images=frames[1:], lossless=True)
    parts = sog_parts(palette_splats(100, 0), 2)
    with pytest.raises(InputError, match="not a readable WebP image"):
        read_splats(store_folder(tmp_path, parts | {"sh0.webp": file.getvalue()}))
