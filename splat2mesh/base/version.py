"""The version of both packages, as files and commands name it; pyproject.toml repeats it."""

VERSION = "0.3.0"

__version__ = VERSION
