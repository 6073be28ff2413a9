"""integrations/web/relight_gash.mjs in node: motors, the network assembled for WebAssembly, turned light, radiance."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from mono import ROOT
from network_file import network_bytes
from scipy.spatial.transform import Rotation

from relight.sh import cga, harmonics
from relight.transfer.neuralgash import neural_gash, unit_points
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
