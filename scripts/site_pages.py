"""Hooks of mkdocs: pages from outside docs/, and links adapted to the position of pages."""

import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File, InclusionLevel

ROOT = Path(__file__).parents[1]

OUTSIDE = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "CHANGELOG.md": "CHANGELOG.md",
    "relight/models/neural-gash.md": "models/neural-gash.md",
    "relight/models/captured-light.md": "models/captured-light.md",
    **{
        path.relative_to(ROOT).as_posix(): path.relative_to(ROOT).as_posix()
        for path in ROOT.glob("integrations/**/README.md")
    },
}
"""File of the repository -> page of the site."""

LINK = re.compile(r"(!?\[[^\[\]]*\]\()([^)\s]+)(\))")


def on_files(files, config):
    """Add the pages that are not in docs/."""
    for source, page in OUTSIDE.items():
        text = (ROOT / source).read_text("utf-8")
        files.append(File.generated(config, page, content=text, inclusion=InclusionLevel.INCLUDED))
    return files


def on_page_markdown(markdown, page, config, files):
    """Turn links within the repository into links within the site; where it lacks a file, keep the words alone."""
    at = page.file.src_uri
    source = {to: name for name, to in OUTSIDE.items()}.get(at, f"docs/{at}")
    known = {file.src_uri for file in files}

    def fitted(match):
        before, target, after = match.groups()
        path, mark, anchor = target.partition("#")
        if re.match(r"[a-z]+:", target) or not path:
            return match[0]
        place = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        to = OUTSIDE.get(place, place.removeprefix("docs/"))
        if to not in known:
            return match[0] if before.startswith("!") else before[1:-2]
        return before + posixpath.relpath(to, posixpath.dirname(at) or ".") + mark + anchor + after

    return LINK.sub(fitted, markdown)
