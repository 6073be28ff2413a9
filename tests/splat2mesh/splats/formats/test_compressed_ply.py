"""PlayCanvas compressed PLY, from files packed here bit by bit."""

import numpy as np
import pytest
from splat_samples import make_splats, quantized, smallest_three, store

from splat2mesh.base.errors import InputError
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.splats import SH_C0


def bit_fields(columns, bits):
    packed = np.zeros(len(columns[0]), np.uint32)
    for column, width in zip(columns, bits, strict=True):
        packed = packed << np.uint32(width) | column
    return packed


def compressed_bytes(splats, order="<", color_bounds=True):
    """A PlayCanvas compressed PLY of `splats`, chunk by chunk."""
    color = splats.sh[:, 0] * SH_C0 + 0.5 if color_bounds else np.clip(splats.sh[:, 0] * SH_C0 + 0.5, 0, 1)
    bounded = [("xyz", splats.means), (["scale_x", "scale_y", "scale_z"], np.log(splats.scales))]
    bounded += [("rgb", color)] if color_bounds else []
    starts = range(0, len(splats), 256)
    chunk = {}
    for end, pick in (("min", np.min), ("max", np.max)):
        for names, values in bounded:
            for i, name in enumerate(names):
                chunk[f"{end}_{name}"] = np.array([pick(values[s : s + 256, i]) for s in starts], np.float32)
    index = np.arange(len(splats)) // 256

    def within(names, values, bits):
        columns = []
        for i, (name, width) in enumerate(zip(names, bits, strict=True)):
            low, high = (chunk.get(f"{end}_{name}", np.full(99, v, float)) for end, v in (("min", 0), ("max", 1)))
            columns.append(quantized(values[:, i], low[index], high[index], width))
        return columns

    largest, small = smallest_three(splats.quats_wxyz)
    packed = {
        "packed_position": bit_fields(within("xyz", splats.means, (11, 10, 11)), (11, 10, 11)),
        "packed_rotation": bit_fields([largest, *quantized(small, -(0.5**0.5), 0.5**0.5, 10).T], (2, 10, 10, 10)),
        "packed_scale": bit_fields(within(bounded[1][0], bounded[1][1], (11, 10, 11)), (11, 10, 11)),
        "packed_color": bit_fields([*within("rgb", color, (8, 8, 8)), quantized(splats.opacities, 0, 1, 8)], (8,) * 4),
    }
    parts = [("chunk", chunk, "float"), ("vertex", packed, "uint")]
    if splats.degree:
        rest = splats.sh[:, 1:].swapaxes(1, 2).reshape(len(splats), -1)
        levels = np.clip(np.floor((rest + 4) * 32), 0, 255).astype(np.uint8)
        parts.append(("sh", {f"f_rest_{i}": levels[:, i] for i in range(rest.shape[1])}, "uchar"))
    header, body = ["ply", f"format binary_{'little' if order == '<' else 'big'}_endian 1.0"], b""
    for element, columns, kind in parts:
        code = order + {"float": "f4", "uint": "u4", "uchar": "u1"}[kind]
        header += [f"element {element} {len(next(iter(columns.values())))}"]
        header += [f"property {kind} {name}" for name in columns]
        body += np.stack(list(columns.values()), axis=1).astype(code).tobytes()
    return "\n".join([*header, "end_header\n"]).encode() + body


@pytest.mark.parametrize("degree", [0, 1, 3])
@pytest.mark.parametrize("order", ["<", ">"])
def test_compressed_ply_is_right_to_its_quantisation(tmp_path, degree, order):
    splats = make_splats(600, degree)  # two whole chunks and a part of a third
    found = read_splats(store(tmp_path, "a.compressed.ply", compressed_bytes(splats, order)))
    # Half a step of the coarsest field (10 bits) over ranges below 8 units; half of 1/255 for opacity, for
    # colour over ranges below 3; rotations: three components half a step of sqrt(2)/1023 off, and the fourth.
    np.testing.assert_allclose(found.means, splats.means, atol=0.5 * 8 / 1023)
    np.testing.assert_allclose(np.log(found.scales), np.log(splats.scales), atol=0.5 * 8 / 1023)
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=0.51 / 255)
    np.testing.assert_allclose(found.colors_diffuse, splats.colors_diffuse, atol=0.5 * 3 / 255)
    np.testing.assert_allclose(found.rotation_matrices(), splats.rotation_matrices(), atol=0.005)
    inside = np.abs(splats.sh[:, 1:]) < 3.9  # the format stops at 4; a cell is 1/32 wide
    np.testing.assert_allclose(found.sh[:, 1:][inside], splats.sh[:, 1:][inside], atol=0.5001 / 32)
    assert found.degree == degree


def test_the_outermost_harmonic_bytes_mean_the_ends(tmp_path):
    splats = make_splats(4, 1)
    values = np.array([-9, 9, -0.01, 0.01], np.float32)  # bytes 0, 255, 127, 128
    splats.sh[:, 1:] = values[:, None, None]
    found = read_splats(store(tmp_path, "a.ply", compressed_bytes(splats)))
    expected = np.broadcast_to(np.array([-4, 4, -1 / 64, 1 / 64])[:, None, None], (4, 3, 3))
    np.testing.assert_array_equal(found.sh[:, 1:], expected)


def test_compressed_ply_without_color_bounds(tmp_path):
    splats = make_splats(30, 0)
    found = read_splats(store(tmp_path, "a.ply", compressed_bytes(splats, color_bounds=False)))
    np.testing.assert_allclose(found.colors_diffuse, np.clip(splats.colors_diffuse, 0, 1), atol=0.51 / 255)


def test_damaged_compressed_plys(tmp_path):
    data = compressed_bytes(make_splats(600, 1))
    for edit, message in [
        ((b"element chunk 3", b"element chunk 2"), "600 splats take 3 chunks of 256, found 2"),
        ((b"uint packed_scale", b"uint packed_skale"), "lacks packed_scale"),
        ((b"min_y", b"mon_y"), "lacks min_y"),
        ((b"max_g", b"mix_g"), "lacks max_g"),
        ((b"element sh 600", b"element sh 599"), "found 599 rows"),
        ((b"f_rest_8", b"f_rest_9"), "expected 0, 9, 24, 45 or 72"),
    ]:
        with pytest.raises(InputError, match=message):
            read_splats(store(tmp_path, "a.ply", data.replace(*edit)))
    for cut in (len(data) - 1, len(data) // 2, len(data) // 20):
        with pytest.raises(InputError, match="cut short"):
            read_splats(store(tmp_path, "a.ply", data[:cut]))
