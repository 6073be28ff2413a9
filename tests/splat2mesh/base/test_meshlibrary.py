"""open3d within a command and for somebody who uses the library."""

import subprocess
import sys

import pytest

SCRIPT = """
import sys
from splat2mesh.base import console
from splat2mesh.base.meshlibrary import PAGES, open3d
console._owns_process = {owned}
package = open3d()
package.t.geometry.RaycastingScene()
assert package is open3d() is sys.modules["open3d"]
print(*(name in sys.modules for name in PAGES))
"""


@pytest.mark.parametrize("owned", [True, False])
def test_a_command_imports_no_web_pages(owned):
    finished = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(owned=owned)], capture_output=True, text=True, check=True, timeout=120
    )
    assert finished.stdout.split() == [str(not owned)] * 3


MISSING = """
import sys
import importlib.util
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name in ("plotly", "dash") else found(name, *rest)
from splat2mesh.base.meshlibrary import PAGES, open3d
package = open3d()
package.t.geometry.RaycastingScene()
print(*(name in sys.modules for name in PAGES))
"""


def test_a_library_process_works_without_the_packages_of_web_pages():
    finished = subprocess.run([sys.executable, "-c", MISSING], capture_output=True, text=True, check=True, timeout=120)
    assert finished.stdout.split() == ["False"] * 3
