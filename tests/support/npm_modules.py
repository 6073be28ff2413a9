"""Where npm modules of the tests may be installed."""

import os
import sys
from pathlib import Path


def folders():
    """Folders, in the order in which they are looked into."""
    named = [Path(folder) for folder in os.environ.get("NODE_PATH", "").split(os.pathsep) if folder]
    return [Path(sys.prefix, "share/node/node_modules"), *named]
