"""integrations/godot: GDScript parsed, its one formula run as Python, the shader compiled and its kernel run."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from engine_shaders import VECTORS, compiled_gdshader, glslang, kernel_values
from probe_lights import LOBE_ERROR, lobe, lobe_irradiance, picture

from relight import Environment
from relight.output.probe_files import irradiance_of
from splat2mesh.base.sphere import fibonacci_sphere

GODOT = Path(__file__).parents[2] / "integrations" / "godot"


@pytest.mark.parametrize("name", ["relight_mesh.gd", "relight_probes.gd"])
def test_the_script_parses(name):
    parser = pytest.importorskip("gdtoolkit.parser", reason="gdtoolkit is not installed").parser
    parser.parse((GODOT / name).read_text(encoding="utf-8"))


def test_the_light_turns_as_in_python():
    text = (GODOT / "relight_mesh.gd").read_text(encoding="utf-8")
    function = re.search(r"static (func turned.*?return result\n)", text, re.DOTALL)[1]
    # GDScript of plain arithmetic is Python but for its declarations.
    function = re.sub(r"func turned\(.*?:\n", "def turned(sh, degrees):\n", function)
    function = function.replace("var ", "").replace(":=", "=").replace("sh.duplicate()", "sh.copy()")
    names = {"deg_to_rad": np.radians, "sqrt": np.sqrt, "sin": np.sin, "cos": np.cos}
    exec(function, names)
    light = Environment(np.random.default_rng(2).uniform(0, 2, (16, 32, 3)))
    np.testing.assert_allclose(names["turned"](light.sh(3), 130.0), light.rotated(130.0).sh(3), atol=1e-9)


def test_the_shader_compiles(tmp_path):
    compiled_gdshader(tmp_path, GODOT / "relight_mesh.gdshader")


def test_its_kernel_is_ours(tmp_path):
    text = (GODOT / "relight_mesh.gdshader").read_text(encoding="utf-8")
    kernel = text[text.index("vec3 relight_radiance") : text.index("void vertex()")]
    found, expected = kernel_values(tmp_path, kernel, "relight")
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=1e-6)


def probe_kernel():
    """The text of relight_irradiance, and of the declarations before it."""
    text = (GODOT / "relight_probes.gdshader").read_text(encoding="utf-8")
    return text[text.index("vec3 relight_irradiance") : text.index("void fragment()")]


def test_the_shader_of_probes_is_the_closed_form(tmp_path):
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    normals = fibonacci_sphere(60)
    main = """int main() { float row[3]; vec3* rows[9] = {&relight_0, &relight_1, &relight_2, &relight_3, &relight_4,
        &relight_5, &relight_6, &relight_7, &relight_8};
        for (int i = 0; scanf("%f %f %f", row, row + 1, row + 2) == 3; i++) { vec3 v(row[0], row[1], row[2]);
        if (i < 9) *rows[i] = v; else { v = relight_irradiance(v); printf("%.9g %.9g %.9g\\n", v.x, v.y, v.z); } } }"""
    uniforms = "vec3 " + ", ".join(f"relight_{j}" for j in range(9)) + ";\n"
    (tmp_path / "kernel.cpp").write_text(VECTORS + uniforms + probe_kernel() + main)
    subprocess.run(["g++", "-O0", "-o", tmp_path / "kernel", tmp_path / "kernel.cpp"], check=True)
    sh = irradiance_of(picture(lobe))
    text = "\n".join(" ".join(map(repr, row.tolist())) for row in np.concatenate([sh, normals]))
    done = subprocess.run([tmp_path / "kernel"], input=text, capture_output=True, text=True, check=True)
    found = np.array(done.stdout.split(), float).reshape(-1, 3)
    np.testing.assert_allclose(found, lobe_irradiance(normals), atol=LOBE_ERROR)


def test_the_shader_of_probes_compiles(tmp_path):
    text = (GODOT / "relight_probes.gdshader").read_text(encoding="utf-8")
    body = re.sub(r"^(shader_type|render_mode).*$", "", text, flags=re.MULTILINE)
    body = re.sub(r"(?:instance )?uniform (\w+) (\w+)(?: :.*?| = .*?);", r"uniform \1 \2;", body)
    declared = "in vec3 NORMAL; in vec2 UV; uniform mat4 INV_VIEW_MATRIX;\nlayout(location=0) out vec4 IRRADIANCE;\n"
    declared += "vec3 ALBEDO; float ROUGHNESS, METALLIC;\n"
    (tmp_path / "probes.frag").write_text("#version 450 core\n" + declared + body + "void main() { fragment(); }\n")
    glslang(tmp_path / "probes.frag", "-S", "frag")


def test_the_nearest_probes_count_most_and_nothing_jumps():
    text = (GODOT / "relight_probes.gd").read_text(encoding="utf-8")
    function = re.search(r"static (func weights.*?return result\n)", text, re.DOTALL)[1]
    function = re.sub(r"func weights\(.*?:\n", "def weights(distances):\n", function)
    function = function.replace("var ", "").replace(":=", "=").replace("distances.size()", "len(distances)")
    function = function.replace("in mini(", "in range(min(").replace("len(distances)):", "len(distances))):")
    function = function.replace("in result.size()", "in range(len(result))")
    names = {"maxf": max}
    exec(function, names)
    distances = np.sort(np.random.default_rng(1).uniform(0.1, 2, 20))
    found = np.array(names["weights"](list(distances)))
    known = (1 / distances[:8] - 1 / distances[8]) ** 2
    np.testing.assert_allclose(found, known / known.sum(), rtol=1e-9)
    np.testing.assert_allclose(names["weights"]([0.0, 1.0]), [1, 0], atol=1e-9)
    np.testing.assert_allclose(names["weights"]([1.0] * 12), [1] + [0] * 7)  # none is nearer than the ninth: the first
