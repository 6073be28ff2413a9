"""Light on a scene: an environment in, the radiance leaving every vertex out, as a mesh, as a splat, as a session.

The stub beside this file lists the public names.
"""

import lazy_loader

# Imported on first use, so that `--help` and `--version` stay instant.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
