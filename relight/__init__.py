"""Light on a scene: an environment in, the radiance leaving every vertex out, as a mesh, as a splat, as a session.

What is public stands in the stub beside this file.
"""

import lazy_loader

# Imported on first use, so that `--help` and `--version` stay instant.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
