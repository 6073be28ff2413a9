"""The Unity loaders compiled by Mono against stand-ins for Unity's classes, and run."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
UNITY = ROOT / "integrations" / "unity"


def compiled(folder):
    """The program, or a skip without Mono."""
    if shutil.which("mcs") is None or shutil.which("mono") is None:
        pytest.skip("Mono's C# compiler is not installed (mono-mcs)")
    path = folder / "run.exe"
    sources = [*UNITY.glob("*.cs"), *(ROOT / "tests" / "support").glob("unity_*.cs")]
    done = subprocess.run(
        ["mcs", "-warnaserror", "-nowarn:649,414", f"-out:{path}", *map(str, sources)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return path


def ran(program, *arguments):
    return subprocess.run(["mono", *map(str, (program, *arguments))], capture_output=True, text=True, timeout=60)


def rows(line, width):
    """Numbers of a line, (N, width)."""
    return np.array(line.split(), float).reshape(-1, width)
