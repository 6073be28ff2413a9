"""Packages imported on use: heavy ones, and those of extras."""

import importlib
from importlib.util import find_spec
from types import ModuleType

from .errors import InputError

EXTRAS = {
    "imageio_ffmpeg": "film",
    "distributed": "cluster",
    "fsspec": "cluster",
    "manifold3d": "proxy",
    "coacd": "proxy",
    "pxr": "usd",
}
"""Package -> the extra of pyproject.toml that brings it; others come with the packages themselves."""


PACKAGES = {"pxr": "usd-core"}
"""Names under which packages are installed, where they are others."""


def needed(
    package: str,  # its name, of EXTRAS or a dependency
    purpose: str,  # what it is for, as the beginning of a sentence
) -> ModuleType:
    """The imported package. Raises InputError, with the command that installs it, where it is missing."""
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:  # the package exists, one of its dependencies does not
            raise
        name = PACKAGES.get(package, package)
        command = f'pip install "splat2mesh[{EXTRAS[package]}]"' if package in EXTRAS else f"pip install {name}"
        raise InputError(f"{purpose} needs {name}, which is not installed: {command}") from None


def installed(package: str) -> bool:
    """Whether a package is there, without importing it."""
    try:
        return find_spec(package) is not None
    except ValueError:  # it was marked as missing in this process
        return False
