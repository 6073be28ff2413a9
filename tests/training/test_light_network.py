"""The network of the captured light: its file computes what torch does, and its training lowers the loss."""

import sys
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from relight.albedo import refined
from splat2mesh.base.sphere import fibonacci_sphere

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")


@pytest.fixture
def training(monkeypatch):
    """The modules; `scripts` holds what makes captures."""
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "scripts"))
    monkeypatch.delitem(sys.modules, "fitting", raising=False)
    from training import captured_light, light_network

    return SimpleNamespace(fit=captured_light, network=light_network)


def given(rng, places, directions):
    """The NetworkInputs and true light of places in the open, lit from one side that the start does not know."""
    toward, normals = fibonacci_sphere(directions), rng.standard_normal((places, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sky = np.maximum(normals @ toward.T, 0.0) * 4.0 / directions
    side = rng.standard_normal(3)
    light = np.exp(1.5 * toward @ side / np.linalg.norm(side))
    received = sky @ light
    captured = received * rng.choice([0.3, 0.5], places)
    unit = np.median(captured)
    dark, flat = np.zeros(places), np.full(directions, np.log(3.0))
    arrays = (
        sky,
        captured / unit,
        dark,
        normals[:, 1],
        flat,
        np.zeros((directions, 3)),
        *refined._cells(toward.tobytes()),
    )
    inputs = refined.NetworkInputs(*(np.ascontiguousarray(each, np.float32) for each in arrays))
    return inputs, (light / unit).astype(np.float32)


def test_the_file_computes_what_torch_does(training):
    """For any number of places and directions, not only those of the example."""
    torch.manual_seed(0)
    network = training.network.Refiner()
    for layer in network.change:
        torch.nn.init.normal_(layer.weight, std=0.1)
    rng = np.random.default_rng(1)
    data = training.network.exported(network, given(rng, 30, 300)[0])
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    for sizes in ((30, 300), (71, 512)):
        inputs, _ = given(rng, *sizes)
        tensors = training.fit._tensors([inputs])
        with torch.no_grad():
            expected = (network(tensors)[-1] - tensors["light"])[0].numpy()
        assert np.abs(expected).max() > 0.05
        np.testing.assert_allclose(session.run(None, inputs._asdict())[0], expected, atol=1e-5)  # float32 sums


def test_training_finds_the_side_of_the_light(training, monkeypatch):
    ticks = count()  # a clock that every machine reads alike
    monkeypatch.setattr(training.fit, "time", SimpleNamespace(monotonic=lambda: next(ticks)))
    monkeypatch.setattr(training.fit, "SEEN_PLACES", 96)
    torch.manual_seed(0)
    rng = np.random.default_rng(2)
    scenes = [[training.fit.Example(*given(rng, 150, 200))] for _ in range(24)]
    network = training.fit._fit(scenes, [], 120.0, rng, lambda line: None)
    held_out = [given(rng, 96, 200) for _ in range(16)]
    tensors = training.fit._tensors([inputs for inputs, _ in held_out])
    tensors["received"] = torch.from_numpy(np.stack([inputs.sky @ light for inputs, light in held_out]))
    with torch.no_grad():
        after = training.network.lost(network(tensors)[-1], tensors).mean()
        before = training.network.lost(tensors["light"], tensors).mean()
    assert after < 0.6 * before
