"""integrations/web/relight_gash.mjs in node: motors, the network assembled for WebAssembly, turned light, radiance."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from mono import ROOT
from network_file import network_bytes
from npm_modules import folders
from scipy.spatial.transform import Rotation

from relight.sh import cga, harmonics
from relight.transfer.neuralgash import UnitFrame, neural_gash, unit_points
from relight.transfer.sessions import open_session

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    path = tmp_path_factory.mktemp("network") / "neural-gash.bin"
    path.write_bytes(network_bytes())
    return path


def ran(*arguments):
    command = ["node", ROOT / "tests" / "support" / "web_network.mjs", ROOT / "integrations", *arguments]
    return subprocess.run([str(each) for each in command], capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("count", [1, 32, 75])
def test_every_step_is_that_of_python(network, tmp_path, count):
    rng = np.random.default_rng(count)
    points = (rng.normal(size=(count, 3)) * [1.0, 0.5, 2.0] + [3.0, 1.0, -2.0]).astype(np.float32)
    normals = rng.normal(size=(count, 3)).astype(np.float32)
    special = np.array([[0, -1, 0], [0, 1, 0], [0, 0, 0], [1e-4, -1, 0], [0, -5, 0], [2, 0, 0]], np.float32)
    normals[6:12] = special[: len(normals[6:12])]
    given = {"points": points.tolist(), "normals": normals.tolist(), "sh": rng.normal(size=(9, 3)).tolist()}
    given |= {"axis": [-0.3, 2.0, 5.0], "angle": 130.0}
    (tmp_path / "given.json").write_text(json.dumps(given))
    done = ran(network, tmp_path / "given.json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    known = np.where(np.linalg.norm(normals, axis=1, keepdims=True) > 0, normals, [0, 1, 0])
    motors = cga.vertex_motors(unit_points(points), known)
    np.testing.assert_allclose(np.reshape(found["motors"], (-1, 32)), motors, atol=1.2e-7)
    (outputs,) = open_session("neural-gash", 1).run(None, {"motor": motors})
    # Weights of 16 bits and sums of float32 in another order: 9e-6 measured.
    np.testing.assert_allclose(np.reshape(found["outputs"], (-1, 27)), outputs, atol=2e-5)
    turn = Rotation.from_rotvec(np.radians(130.0) * np.array(given["axis"]) / np.linalg.norm(given["axis"])).as_matrix()
    sh = harmonics.rotation_matrix(turn, 3) @ given["sh"]
    np.testing.assert_allclose(found["sh"], sh, atol=1e-12)
    radiance = np.maximum(neural_gash(points, known) @ sh, 0.0)
    np.testing.assert_allclose(np.reshape(found["radiance"], (-1, 3)), radiance, atol=1e-4)


@pytest.mark.parametrize("change", ["start", "end", "other", "version"])
def test_another_file_is_refused_in_one_line(network, tmp_path, change):
    data = network.read_bytes()
    changed = {"start": data[:30], "end": data[:-1], "other": b"\0" * 40, "version": data[:4] + b"\2" + data[5:]}
    (tmp_path / "neural-gash.bin").write_bytes(changed[change])
    done = ran(tmp_path / "neural-gash.bin", "-")
    assert done.returncode == 2 and done.stdout == "" and done.stderr.count("\n") == 1
    assert "neural-gash.bin" in done.stderr


def test_a_skin_takes_points_and_normals_along(tmp_path):
    modules = next((each for each in folders() if (each / "three").is_dir()), None)
    if modules is None:
        pytest.skip("the npm module three is not installed")
    for path in (*(ROOT / "integrations").glob("*/*.mjs"), ROOT / "tests" / "support" / "skinned_mesh.mjs"):
        shutil.copy(path, tmp_path)
    (tmp_path / "node_modules").symlink_to(modules)
    rng = np.random.default_rng(7)
    points, normals, weights = rng.normal(size=(20, 3)), rng.normal(size=(20, 3)), rng.uniform(size=20)
    bones = np.tile(np.eye(4), (2, 1, 1))
    bones[:, :3, :3] = Rotation.random(2, rng=rng).as_matrix()
    bones[:, :3, 3] = rng.normal(size=(2, 3))
    given = {"points": points.ravel().tolist(), "normals": normals.ravel().tolist(), "weights": weights.tolist()}
    given |= {"bones": bones.reshape(2, 16).tolist()}
    (tmp_path / "given.json").write_text(json.dumps(given))
    command = ["node", tmp_path / "skinned_mesh.mjs", tmp_path / "given.json"]
    done = subprocess.run([str(each) for each in command], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    blended = weights[:, None, None] * bones[0] + (1 - weights)[:, None, None] * bones[1]
    posed = np.einsum("nij,nj->ni", blended[:, :3, :3], points) + blended[:, :3, 3]
    np.testing.assert_allclose(np.reshape(found["points"], (-1, 3)), posed, atol=1e-5)
    turned = np.einsum("nij,nj->ni", blended[:, :3, :3], normals)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    np.testing.assert_allclose(np.reshape(found["normals"], (-1, 3)), turned, atol=1e-5)
    np.testing.assert_allclose(np.reshape(found["colors"], (-1, 3)), np.tile([0.5, 0.5, 3.0], (20, 1)), rtol=1e-6)
    np.testing.assert_allclose(found["frame"]["middle"], UnitFrame.of(points).middle, atol=1e-6)  # of the pose at rest
