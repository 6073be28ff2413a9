"""What networks learn from: meshes and labels; and the training itself, where torch is."""

import subprocess
import sys
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from motors import taken_apart

from relight.sh import cga
from relight.transfer.analytic import analytic
from relight.transfer.neuralgash import unit_points
from scenes import shapes
from splat2mesh.base.errors import InputError
from training import meshes
from training.labels import as_rgb, transfer_labels

ROOT = Path(__file__).resolve().parents[2]


def ball(edge=0.15):
    points, faces = shapes.blob(0.5, 0.0, np.random.default_rng(0), edge)
    return meshes.TrainingMesh("ball", points, shapes.vertex_normals(points, faces), faces)


@pytest.mark.parametrize("kind", sorted(meshes.KINDS))
def test_every_kind_is_closed_and_faces_outward(kind):
    for seed in range(3):
        mesh = meshes.generate(kind, seed)
        assert mesh.name == f"{kind} {seed}" and 0.4 * meshes.FEWEST < len(mesh.vertices) < 3 * meshes.MOST
        assert np.unique(mesh.faces).size == len(mesh.vertices)
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)
        edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
        paired = np.isin(edges @ [1, 10**6], edges[:, ::-1] @ [1, 10**6])
        a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(float) - mesh.vertices[0] for corner in range(3))
        if kind == "terrain":  # an open sheet: only its rim is unpaired
            assert 0 < np.sum(~paired) < 0.1 * len(edges)
        else:
            assert paired.all() and (np.cross(a, b) * c).sum() > 0.0


def test_meshes_repeat_by_seed_and_differ_by_number():
    first, again, other = (list(meshes.generated(12, seed)) for seed in (4, 4, 5))
    for one, two in zip(first, again, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one[1:], two[1:], strict=True))
    assert {mesh.name for mesh in first}.isdisjoint(mesh.name for mesh in other)
    assert {mesh.name.split()[0] for mesh in first} == set(meshes.KINDS)
    sizes = [np.ptp(mesh.vertices, axis=0).max() for mesh in first]
    assert max(sizes) > 10 * min(sizes)
    assert len(list(meshes.generated(3, 4))) == 3 and np.array_equal(first[2].vertices, again[2].vertices)


def test_a_kind_that_is_none_is_refused():
    with pytest.raises(InputError, match=r"'teapot': expected one of blob, box"):
        meshes.generate("teapot", 0)


def test_a_folder_gives_its_meshes_by_name(tmp_path):
    with pytest.raises(InputError, match="expected mesh files"):
        list(meshes.from_folder(tmp_path))
    for name in ("b", "a"):
        (tmp_path / f"{name}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    found = list(meshes.from_folder(tmp_path))
    assert [mesh.name for mesh in found] == ["a", "b"]
    np.testing.assert_allclose(found[0].normals, [[0, 0, 1]] * 3)


def test_rotations_are_rotations_and_uniform():
    rng = np.random.default_rng(2)
    turns = np.stack([meshes.random_rotation(rng) for _ in range(4000)])
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (4000, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1.0, atol=1e-12)
    # Over all rotations the mean is 0 and that of R_ij^2 is 1/3; six deviations of 4000 samples.
    np.testing.assert_allclose(turns.mean(axis=0), 0.0, atol=6 * np.sqrt(1 / 3 / 4000))
    np.testing.assert_allclose((turns**2).mean(axis=0), 1 / 3, atol=6 * np.sqrt(4 / 45 / 4000))


def test_what_nothing_hides_is_labelled_with_the_analytic_transfer():
    mesh = ball()
    labels = transfer_labels(mesh, 4, 16)
    np.testing.assert_allclose(labels, analytic(mesh.normals, 4), atol=1e-6)


def test_rows_of_27_hold_three_colours_of_each_harmonic():
    grey = np.arange(18.0).reshape(2, 9)
    rows = as_rgb(grey)
    assert rows.shape == (2, 27)
    assert all(rows[1, 3 * j + k] == grey[1, j] for j in range(9) for k in range(3))


@pytest.fixture(scope="module")
def gash():
    torch = pytest.importorskip("torch")
    pytest.importorskip("onnx")
    torch.set_num_threads(1)
    from training import gash

    return gash


def test_a_turned_mesh_is_labelled_like_the_mesh_turned(gash):
    """A round of a torus: its motors hold points of the turned torus, its rows what an open sky gives their normals."""
    points, faces = shapes.torus(0.3, 0.02, 0.02)
    normals = shapes.vertex_normals(points, faces)
    example = gash.Example("ring", 7.0 * points + 3.0, normals, analytic(normals, 3))
    (batch,) = gash._round("motor", [example] * 8, np.random.default_rng(4))
    motors, rows = (tensor.numpy() for tensor in batch)
    assert motors.shape == (gash.BATCH, 32) and rows.shape == (gash.BATCH, 27)
    turn, places = taken_apart(motors)
    turned = turn.apply([0.0, 1.0, 0.0])
    np.testing.assert_allclose(rows, as_rgb(analytic(turned, 3)), atol=1e-5)
    assert np.linalg.norm(places, axis=1).max() <= 1.0 + 1e-6
    # Off the ring's axis by the tube's radius along the normal: still the same solid, however it is turned.
    core = places - 0.02 / 0.32 * turned * np.linalg.norm(places, axis=1).max()
    assert np.std(np.linalg.norm(core, axis=1)) < 0.05
    assert np.abs(np.linalg.svd(turned - turned.mean(axis=0))[1]).min() > 1.0  # many poses, not one


def test_inputs_are_those_of_inference(gash):
    mesh = ball()
    motors = gash.encoded("motor", 5.0 * mesh.vertices - 8.0, mesh.normals)
    assert np.abs(motors - cga.vertex_motors(unit_points(mesh.vertices), mesh.normals)).max() < 1e-6
    six = gash.encoded("euclidean", 5.0 * mesh.vertices - 8.0, mesh.normals)
    np.testing.assert_allclose(six, np.hstack([unit_points(mesh.vertices), mesh.normals]), atol=1e-6)


def test_dropout_decays_over_the_layers(gash):
    layers = list(gash.network_of("motor"))
    rates = [layer.p for layer in layers if isinstance(layer, gash.nn.Dropout)]
    assert len(rates) == 4 and all(after == before / 2 for before, after in pairwise(rates))
    widths = [(layer.in_features, layer.out_features) for layer in layers if isinstance(layer, gash.nn.Linear)]
    assert widths == [(32, 1024), (1024, 512), (512, 256), (256, 128), (128, 27)]


@pytest.fixture(scope="module")
def examples(gash):
    return gash.labelled(meshes.generated(10, 6))


@pytest.mark.parametrize("kind", ["motor", "euclidean"])
def test_a_trained_network_is_better_and_runs_the_same_everywhere(gash, examples, monkeypatch, kind):
    import onnxruntime
    import torch

    monkeypatch.setattr(gash, "WIDTHS", (96, 64, 48, 32))
    monkeypatch.setattr(gash, "_short_floats_are_faster", lambda: False)
    ticks = count()  # a clock that every machine reads alike
    monkeypatch.setattr(gash, "time", SimpleNamespace(process_time=lambda: next(ticks)))
    torch.manual_seed(0)
    before = np.mean(list(gash.errors(gash.network_of(kind), kind, examples, 100).values()))
    lines = []
    network = gash.fit(kind, examples, examples[:3], 120.0, 0, lines.append)
    after = gash.errors(network, kind, examples, 100)
    assert before > 0.9 and np.mean(list(after.values())) < 0.7, "1.00 says nothing, constant rows 0.8"
    assert "kept" in lines[-1]

    session = onnxruntime.InferenceSession(gash.exported(network, kind, lines), providers=["CPUExecutionProvider"])
    inputs = gash.encoded(kind, examples[2].vertices, examples[2].normals)
    network.eval()
    with torch.no_grad():
        expected = network(torch.from_numpy(inputs)).numpy()
    # Folding the batch-norm and other orders of the sums: 1e-6 of the largest activations, some tens here.
    np.testing.assert_allclose(session.run(None, {kind: inputs})[0], expected, rtol=0, atol=2e-5)
    meta = session.get_modelmeta().custom_metadata_map
    assert meta["log"] == "\n".join(lines) and "reference" in meta


def test_labelled_meshes_are_lit(gash):
    """A ball inside another: none of it is left, and all of the other."""
    small, large = ball(), ball()
    both = meshes.TrainingMesh(
        "two",
        np.concatenate([0.5 * small.vertices, large.vertices]),
        np.concatenate([small.normals, large.normals]),
        np.concatenate([small.faces, large.faces + len(small.vertices)]),
    )
    (example,) = gash.labelled([both])
    np.testing.assert_array_equal(example.vertices, large.vertices)
    assert (example.transfer[:, 0] > 0.0).all()


def test_train_writes_the_network_with_its_log(gash, monkeypatch, tmp_path):
    monkeypatch.setattr(gash, "QUICK_MESHES", 2)
    monkeypatch.setattr(gash, "QUICK_HELD_OUT", 1)
    said = []
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    options = SimpleNamespace(meshes=tmp_path / "more", minutes=0.002, seed=1, out=tmp_path / "new", quick=True)
    options.euclidean, options.say = False, said.append
    (line,) = gash.train(options)
    file = tmp_path / "new" / "neural-gash.onnx"
    assert line == f"{file}: {file.stat().st_size:,} bytes"
    assert said[0].startswith("motor: 3 meshes with ")


def test_the_command_explains_itself_without_torch():
    done = subprocess.run(
        [sys.executable, ROOT / "scripts" / "train", "--help"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0 and "neural-gash" in done.stdout and "--minutes" in done.stdout
    wrong = subprocess.run(
        [sys.executable, ROOT / "scripts" / "train", "x"], capture_output=True, text=True, timeout=60
    )
    assert wrong.returncode == 2 and "Traceback" not in wrong.stderr
