"""One HTML file that shows splats under live light; a folder to serve where one file would be too large.

The SuperSplat viewer (MIT, `web/viewer`) draws; `web/*.js` beside it read the bundle and light it. In the file all
of it is packed: gzip where that helps, then base64. In the folder the page reads the bundle beside it.
"""

import base64
import gzip
import json
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .bundle import META, proxy_glb, write_bundle

if TYPE_CHECKING:
    from .live import Live

MOST_PACKED = 60_000_000
"""Bytes of one file above which the page is a folder, since browsers hold several copies: 1.5 million splats."""

PAGE, FOLDER, INDEX = "relit.html", "web", "index.html"

_WEB = Path(__file__).parent / "web"

_LIBRARY = (
    *("primaries", "light", "piz", "splats", "shadow", "objects", "framing", "gloss", "ground", "parts", "exr"),
    *("indicator", "live", "hand", "brush"),
)
"""Modules that the page joins into one, each after its imports. Their top-level names must differ."""

_PAGE = "layout", "host", "recolour_shaders", "recolour", "floor", "panel", "movement", "painting", "page"
"""Scripts that stand in one block with the viewer, whose engine they use."""

_LOW_PASS = (
    ("cov[0][0] + 0.3;", "cov[0][0] + 1.2;"),
    ("cov[1][1] + 0.3;", "cov[1][1] + 1.2;"),
    ("aRaw + 0.3;", "aRaw + 1.2;"),
    ("cRaw + 0.3;", "cRaw + 1.2;"),
)
"""Widening of a splat on screen: 0.3 of a squared pixel, as in training. The viewer adds it to the square of half
pixels, a fourth of that, which makes its pictures too sharp: 37 dB from ours, 45 with this."""

_FRAME_KEY = "controllers.orbit.goto(frameCamera)", "controllers.orbit.goto(relightCamera?.() ?? frameCamera)"
"""The view of the key F: the viewer itself frames the box of all splats, however far the strays lie."""

_TEMPLATE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{css}
html, body {{ height: 100%; margin: 0; overflow: hidden; background: #212123; }}</style>
<script type="application/json" id="live-data">{data}</script>
<script>{boot}</script>
</head>
<body>
{packed}</body>
</html>
"""

_SCRIPT = "viewer"
"""Name under which the page holds its own script, packed like a file, which comes first."""


def write_page(folder: str | os.PathLike[str], live: "Live", turn: float = 0.0, most: int = MOST_PACKED) -> list[str]:
    """Write the page of a Live into a folder that exists; returns the names of its files.

    turn: degrees that the first light is turned by at the start. most: bytes above which it is a folder.
    """
    folder = Path(folder)
    bundle = folder / FOLDER
    bundle.mkdir()
    names = write_bundle(bundle, live, exact=False)
    meta = json.loads((bundle / META).read_text("utf-8"))
    contents = {name: (bundle / name).read_bytes() for name in names if name != META}
    contents["proxy.glb"] = proxy_glb(*live.proxy, normals=False)
    page = page_of(meta, names, contents, turn)
    if len(page) <= most:
        shutil.rmtree(bundle)
        (folder / PAGE).write_text(page, "utf-8", "replace")
        return [PAGE]
    (bundle / INDEX).write_text(page_of(meta, names, None, turn), "utf-8", "replace")
    return [f"{FOLDER}/{name}" for name in (INDEX, *names)]


def page_of(
    meta: Mapping[str, Any], names: Sequence[str], contents: Mapping[str, bytes] | None = None, turn: float = 0.0
) -> str:
    """The page as text. meta: dict of live.json. names: files of the bundle. contents: dict of their bytes to pack into
    the page; without it, the page reads the files beside it."""
    names = [name for name in names if name != META]
    data = {"meta": meta, "files": names, "packed": contents is not None, "turn": turn}
    data["splat"] = meta["splats"][0]["file"]
    rows = {meta[key]["file"]: meta[key]["bytes"] for key in ("transfer", "surface")}
    title = f"{meta['source'].get('file', 'Splats')}, relit"
    return page_text(title, data, script_of(_LIBRARY, _PAGE), contents or {}, rows)


def page_text(
    title: str,
    data: Mapping[str, Any],
    script: str,
    contents: Mapping[str, bytes],
    rows: Mapping[str, int] | None = None,
) -> str:
    """A page that shows the viewer. data: what its script finds in it. contents: the bytes of files that are packed
    into it. rows: bytes of the rows of those whose neighbours are alike."""
    packed = "".join(
        f'<script type="text/plain" data-file="{name}"{_packed(content, (rows or {}).get(name))}</script>'
        f"<script>unpack()</script>\n"
        for name, content in ({_SCRIPT: script.encode("utf-8")} | dict(contents)).items()
    )
    return _TEMPLATE.format(
        title=title.replace("<", "&lt;"),
        css=_text("viewer/index.css") + _text("page.css"),
        data=json.dumps(data).replace("<", "\\u003c"),
        boot=_text("boot.js"),
        packed=packed,
    )


def _packed(content: bytes, width: int | None) -> str:
    """The attributes and the text of a file.

    width: bytes of its rows, where neighbours are alike: then all their first bytes are stored, all their second, and
    so on, as differences from the row before if that is smaller.
    """
    versions = {"": content}
    if width:
        planes = np.frombuffer(content, np.uint8).reshape(-1, width)
        steps = np.diff(planes, axis=0, prepend=np.zeros((1, width), np.uint8))
        kind = f' data-planes="{width}"'
        versions = {kind: planes.T.tobytes(), f"{kind} data-steps": steps.T.tobytes()}
    found = {kind: gzip.compress(each, 6, mtime=0) for kind, each in versions.items()}
    best = min(found, key=lambda each: len(found[each]))
    if len(found[best]) >= len(content):
        return f">{base64.b64encode(content).decode()}"
    return f"{best} data-gzip>{base64.b64encode(found[best]).decode()}"


def script_of(library_names: Sequence[str] = _LIBRARY, page_names: Sequence[str] = _PAGE) -> str:
    """The viewer and what lights it as one module; names of ours in a block of their own. library_names: modules that
    become one, each after its imports. page_names: scripts beside the viewer."""
    viewer = re.sub(r"^export \{[^}]*\};\s*$", "", _text("viewer/index.js"), flags=re.MULTILINE)
    for theirs, ours in (*_LOW_PASS, _FRAME_KEY):
        viewer = viewer.replace(theirs, ours)
    library = [_text(f"{name}.js") for name in library_names]
    names = [
        name
        for part in library
        for name in re.findall(r"^export (?:async )?(?:const|function|class) (\w+)", part, re.M)
    ]
    parts = [re.sub(r"^import .*$", "", re.sub(r"^export ", "", part, flags=re.M), flags=re.M) for part in library]
    library_text = "".join(parts)
    ours = "\n".join(_text(f"{name}.js") for name in page_names)
    return (
        f"let relightCamera = null;\n{viewer}\n"
        f"{{\nconst Live = (() => {{\n{library_text}\nreturn {{ {', '.join(names)} }};\n}})();\n{ours}\n}}\n"
    )


def _text(name: str) -> str:
    return (_WEB / name).read_text("utf-8")
