"""Trained Gaussian splat in, clean chunked triangle mesh out. The stub beside this file lists the public names."""

import lazy_loader

# Imported on first use, so `--help` and `--version` stay instant.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
