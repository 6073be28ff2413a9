"""integrations/godot: GDScript parsed, its one formula run as Python, the shader compiled and its kernel run."""

import re
from pathlib import Path

import numpy as np
import pytest
from engine_shaders import compiled_gdshader, kernel_values

from relight import Environment

GODOT = Path(__file__).parents[2] / "integrations" / "godot"


def test_the_script_parses():
    parser = pytest.importorskip("gdtoolkit.parser", reason="gdtoolkit is not installed").parser
    parser.parse((GODOT / "relight_mesh.gd").read_text(encoding="utf-8"))


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
