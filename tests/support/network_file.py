"""neural-gash.bin, as integrations/web/make_gash.py writes it."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "integrations" / "web" / "make_gash.py"


def network_bytes():
    """Its bytes, or a skip without the package onnx."""
    pytest.importorskip("onnx", reason="onnx is not installed")
    spec = spec_from_file_location("make_gash", SCRIPT)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.packed()
