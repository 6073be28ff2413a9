"""Optional packages: extras of the installation provide them, and they are imported where they are used."""

import importlib
from importlib.util import find_spec
from types import ModuleType

from .errors import InputError

EXTRAS = {
    "onnxruntime": "networks",
    "pyvista": "view",
    "imageio_ffmpeg": "film",
    "distributed": "cluster",
    "fsspec": "cluster",
    "manifold3d": "proxy",
    "coacd": "proxy",
    "pxr": "usd",
}
"""Package -> the extra of pyproject.toml that brings it."""


PACKAGES = {"pxr": "usd-core"}
"""Names under which packages are installed, where they are others."""


def needed(
    package: str,  # a key of EXTRAS
    purpose: str,  # what it is for, as the beginning of a sentence
) -> ModuleType:
    """The imported package. Raises InputError, with the command that installs it, where it is missing."""
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:  # the package is there, and something that it needs is not
            raise
        extra = EXTRAS[package]
        package = PACKAGES.get(package, package)
        command = f'pip install "splat2mesh[{extra}]"'
        raise InputError(f"{purpose} needs {package}, which is not installed: {command}") from None


def installed(package: str) -> bool:
    """Whether a package is there, without importing it."""
    try:
        return find_spec(package) is not None
    except ValueError:  # it was marked as missing in this process
        return False
