"""The paper's network: what its file holds, what it may depend on, and what it says of the worst input."""

import json
import sys
from importlib import resources
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import onnxruntime
import pytest

from relight.sh import cga
from relight.transfer import neuralgash, sessions
from relight.transfer.analytic import analytic
from relight.transfer.neuralgash import neural_gash, unit_points
from relight.transfer.occluder import Occluder
from relight.transfer.visibility import raytraced_scene
from scenes import shapes
from splat2mesh.base.errors import DataWarning, InputError

OPEN = np.float32(np.sqrt(0.25 / np.pi))
"""First coefficient of a vertex that sees all its sky."""

BALL_ERROR = 0.05
"""0.015 when it was trained; another training gives another."""

ROUNDING = 2e-6
"""Other batches, other runtimes: sums of up to 1024 float32 products in another order, on outputs of 0.3 at most."""


def vertices_and_normals(count=3000, seed=0):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return rng.uniform(-1.0, 1.0, (count, 3)).astype(np.float32), normals.astype(np.float32)


def possible(transfer):
    return np.isfinite(transfer).all() and (transfer[:, 0] >= 0.0).all() and (transfer[:, 0] <= OPEN).all()


def test_the_file_says_in_this_runtime_what_the_network_said_in_torch():
    session = sessions.open_session("neural-gash", 1)
    reference = json.loads(session.get_modelmeta().custom_metadata_map["reference"])
    motors, expected = (np.array(reference[key], np.float32) for key in ("input", "output"))
    assert motors.shape[1] == 32 and expected.shape == (len(motors), 27) and np.abs(expected).max() > 0.1
    # Batch-norm folded into the weights rounds them once more.
    np.testing.assert_allclose(session.run(None, {"motor": motors})[0], expected, rtol=0, atol=1e-5)


def test_the_file_is_the_paper_s_network_of_plain_operators():
    onnx = pytest.importorskip("onnx")
    model = onnx.load_from_string((resources.files("relight") / "models" / "neural-gash.onnx").read_bytes())
    onnx.checker.check_model(model, full_check=True)
    assert [entry.version for entry in model.opset_import] == [15]
    assert [node.op_type for node in model.graph.node] == ["Gemm", "Sigmoid", "Mul"] * 4 + ["Gemm"]
    arrays = {array.name: onnx.numpy_helper.to_array(array) for array in model.graph.initializer}
    widths = [32, 1024, 512, 256, 128, 27]
    assert [arrays[f"weight{layer}"].shape for layer in range(5)] == list(pairwise(widths))

    motors = cga.vertex_motors(*vertices_and_normals(100))
    value = motors.astype(np.float64)
    for layer in range(5):
        value = value @ arrays[f"weight{layer}"] + arrays[f"bias{layer}"]
        if layer < 4:
            value = value / (1.0 + np.exp(-value))
    found = sessions.open_session("neural-gash", 1).run(None, {"motor": motors})[0]
    np.testing.assert_allclose(found, value, rtol=0, atol=1e-5)


def test_it_is_the_mean_of_three_colours_of_the_motors_in_the_unit_frame():
    vertices, normals = vertices_and_normals(50)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    motors = cga.vertex_motors((vertices - (low + high) / 2.0) / (0.5 * np.linalg.norm(high - low)), normals)
    rows = sessions.open_session("neural-gash", 1).run(None, {"motor": motors})[0]
    expected = rows.reshape(-1, 9, 3).mean(axis=2)
    expected[:, 0] = np.clip(expected[:, 0], 0.0, OPEN)
    np.testing.assert_allclose(neural_gash(vertices, normals), expected, rtol=0, atol=ROUNDING)


def test_neither_order_nor_batches_matter(monkeypatch):
    vertices, normals = vertices_and_normals()
    whole = neural_gash(vertices, normals)
    order = np.random.default_rng(1).permutation(len(vertices))
    np.testing.assert_allclose(neural_gash(vertices[order], normals[order]), whole[order], rtol=0, atol=ROUNDING)
    monkeypatch.setattr(neuralgash, "BATCH", 77)
    counts = []
    np.testing.assert_allclose(neural_gash(vertices, normals, counts.append), whole, rtol=0, atol=ROUNDING)
    assert sum(counts) == len(vertices) and max(counts) == 77
    assert np.array_equal(neural_gash(vertices, normals), neural_gash(vertices, normals))


def test_size_and_place_do_not_matter():
    vertices, normals = vertices_and_normals(500)
    # The bounds are exact in float32, so that only the unit frame itself rounds.
    whole = neural_gash(vertices, normals)
    assert np.array_equal(neural_gash(2.0**70 * vertices, normals), whole)
    assert np.array_equal(neural_gash(2.0**-70 * vertices, normals), whole)
    np.testing.assert_allclose(neural_gash(vertices.astype(float) + 1e6, normals), whole, rtol=0, atol=1e-5)


def test_the_unit_frame_is_the_half_diagonal():
    points = unit_points([[1.0, 0.0, 0.0], [5.0, 2.0, 4.0], [3.0, 1.0, 2.0]])
    np.testing.assert_allclose(points, [[-2 / 3, -1 / 3, -2 / 3], [2 / 3, 1 / 3, 2 / 3], [0, 0, 0]], atol=1e-15)
    assert np.isfinite(unit_points(np.array([[-3e38] * 3, [3e38] * 3], np.float32))).all()


def test_it_has_learned_what_normals_do():
    """On a ball, which it never saw but whose like it did, and on one with a dent; analytic is exact on the ball."""
    points, faces = shapes.blob(0.5, 0.0, np.random.default_rng(0), 0.05)
    normals = shapes.vertex_normals(points, faces)
    exact = analytic(normals, 3)
    assert np.linalg.norm(neural_gash(points, normals) - exact) < BALL_ERROR * np.linalg.norm(exact)


def test_it_has_learned_something_of_shadows():
    """In the hole of a torus it is nearer to the truth than without shadows."""
    points, faces = shapes.torus(0.3, 0.18, 0.05)
    normals = shapes.vertex_normals(points, faces)
    inside = (points[:, [0, 2]] ** 2).sum(axis=1) < 0.25**2
    truth = raytraced_scene(Occluder(points, normals, faces), 3, 64)[inside]
    found, open_sky = neural_gash(points, normals)[inside], analytic(normals[inside], 3)
    assert np.linalg.norm(found - truth) < np.linalg.norm(open_sky - truth)


@pytest.mark.parametrize(
    "vertices",
    [
        pytest.param([[0.0, 0.0, 0.0]], id="one vertex"),
        pytest.param([[7.0, 7.0, 7.0]] * 5, id="all in one place"),
        pytest.param(np.eye(3) * 1e30, id="huge"),
        pytest.param(np.eye(3) * 1e-40, id="tiny"),
        pytest.param([[-3e38, 0.0, 0.0], [3e38, 0.0, 0.0], [0.0, 0.0, 3e38]], id="as far as floats go"),
        pytest.param([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1e30, 0.0, 0.0]], id="one lost far off"),
    ],
)
@pytest.mark.parametrize("normal", [(0, -1, 0), (0, 1, 0), (1e-3, -1, 0), (0, 0, 5)])
def test_the_worst_input_gives_what_a_white_vertex_can_have(vertices, normal):
    transfer = neural_gash(np.asarray(vertices, np.float32), np.tile(np.float32(normal), (len(vertices), 1)))
    assert transfer.shape == (len(vertices), 9) and transfer.dtype == np.float32 and possible(transfer)


def test_what_the_network_cannot_mean_is_cut(monkeypatch):
    class Wild:
        def run(self, outputs, inputs):
            return (np.resize(np.float32([1e30, -1e30, 5.0]), (len(inputs["motor"]), 27)),)

        def get_providers(self):
            return ["CUDAExecutionProvider", "CPUExecutionProvider"]

    monkeypatch.setattr(neuralgash, "open_session", lambda *arguments: Wild())
    assert possible(neural_gash(*vertices_and_normals(10)))


def test_vertices_without_a_normal_face_up():
    vertices, normals = vertices_and_normals(40)
    normals[:3], normals[3], normals[4] = 0.0, np.nan, 1e-9
    repaired = normals.copy()
    repaired[:5] = [0.0, 1.0, 0.0]
    with pytest.warns(DataWarning, match="5 of 40 vertices have no normal") as caught:
        found = neural_gash(vertices, normals)
    assert len(caught) == 1 and np.array_equal(found, neural_gash(vertices, repaired))


def test_no_vertices_give_no_rows():
    assert neural_gash(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 9)


@pytest.mark.parametrize(
    ("vertices", "normals", "says"),
    [
        (np.zeros((3, 2)), np.zeros((3, 2)), "shape"),
        (np.zeros((3, 3)), np.zeros((2, 3)), "shape"),
        (np.zeros(3), np.zeros(3), "shape"),
        ([[0, 0, np.nan], [0, np.inf, 0], [1, 1, 1]], np.ones((3, 3)), "2 of 3 vertices are not finite"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, normals, says):
    with pytest.raises(InputError, match=says):
        neural_gash(vertices, normals)


def test_threads_of_a_session_sleep_and_are_as_many_as_asked():
    options = sessions.open_session("neural-gash", 2).get_session_options()
    assert options.intra_op_num_threads == 2
    assert options.get_session_config_entry("session.intra_op.allow_spinning") == "0"


def test_accelerators_come_before_the_processor(monkeypatch):
    asked = []
    there = ["AzureExecutionProvider", "CPUExecutionProvider", "CUDAExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: there)
    monkeypatch.setattr(onnxruntime, "InferenceSession", lambda *_, providers: asked.extend(providers))
    sessions.open_session("neural-gash", 1)
    assert [name for name, _ in asked] == ["CUDAExecutionProvider", "CPUExecutionProvider"]


def test_only_the_processor_serves_several_at_once(monkeypatch):
    monkeypatch.setattr("splat2mesh.base.threads.all_cores", lambda: 7)
    session = sessions.open_session("neural-gash", 1)
    processor_only = session.get_providers() == ["CPUExecutionProvider"]
    assert sessions.workers_of(session) == (7 if processor_only else 1)
    accelerated = SimpleNamespace(get_providers=lambda: ["DmlExecutionProvider", "CPUExecutionProvider"])
    assert sessions.workers_of(accelerated) == 1


def test_without_onnxruntime_one_line_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(InputError, match=r"needs onnxruntime.*pip install onnxruntime") as caught:
        neural_gash(*vertices_and_normals(2))
    assert "\n" not in str(caught.value)


def test_a_network_that_is_missing_or_broken_is_named(monkeypatch, tmp_path):
    with pytest.raises(InputError, match=r"no-such\.onnx in relight/models, found none"):
        sessions.open_session("no-such", 1)
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "bad.onnx").write_bytes(b"not a network")
    monkeypatch.setattr(sessions.resources, "files", lambda package: tmp_path)
    with pytest.raises(InputError, match=r"bad\.onnx cannot be used") as caught:
        sessions.open_session("bad", 1)
    assert "\n" not in str(caught.value)
