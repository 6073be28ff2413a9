"""A GLB as the Khronos validator sees it."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest


def validator_issues(path):
    """The Khronos validator's report on a file. Skips where node or the gltf-validator module is missing."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    folders = [Path(sys.prefix, "share/node/node_modules")]
    folders += [Path(folder) for folder in os.environ.get("NODE_PATH", "").split(os.pathsep) if folder]
    modules = next((folder for folder in folders if (folder / "gltf-validator").is_dir()), None)
    if modules is None:
        pytest.skip("the npm module gltf-validator is not installed (scripts/setup tests installs it)")
    script = Path(__file__).with_name("gltf_validator.mjs")
    done = subprocess.run(["node", script, modules, path], capture_output=True, text=True, check=True, timeout=60)
    return json.loads(done.stdout)
