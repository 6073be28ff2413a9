"""Hooks of mkdocs: pages that lie outside docs/, the reference from docstrings, and links that fit where pages go."""

import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File, InclusionLevel

ROOT = Path(__file__).parents[1]

PARTS = {"python.md": "From Python", "browser.md": "In the browser", "limits.md": "Limits"}
"""Page of the site -> the heading of README.md whose part it is."""

WHOLE = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "CHANGELOG.md": "CHANGELOG.md",
    **{f"relight/models/{name}.md": f"models/{name}.md" for name in ("neural", "neural-gash")},
    **{
        path.relative_to(ROOT).as_posix(): path.relative_to(ROOT).as_posix()
        for path in ROOT.glob("integrations/**/README.md")
    },
}
"""File of the repository -> page of the site."""

REFERENCE = {
    "splat2mesh": (
        *("convert", "mesh_files", "plan_mesh", "ConvertOptions", "TilingOptions", "MeshedFiles", "add_proxy"),
        *("Scene", "Splats", "Stages", "InputError", "UnfinishedError", "DataWarning"),
    ),
    "relight": (
        *("relight_splat", "relight_scene", "relight_files", "plan_relight", "estimate_albedo"),
        *(
            "RelightRequest",
            "LightingOptions",
            "Environment",
            "Relighter",
            "Shading",
            "Plan",
            "RelightPlan",
            "Appearance",
        ),
        *("RelitScene", "RelitSplat", "RelitFiles"),
        *("view", "view_request", "serve", "serve_request", "record_turntable"),
    ),
}
"""Package -> what of it is public; a test holds it against __all__."""

LINK = re.compile(r"(!?\[[^\[\]]*\]\()([^)\s]+)(\))")


def part(text, heading):
    """The part of a document under a heading of any level, that made the title of a page."""
    found = re.search(rf"^(#+) {re.escape(heading)}\n(.*?)(?=^#{{1,2}} |\Z)", text, re.MULTILINE | re.DOTALL)
    return f"# {heading}\n{found[2]}"


def on_files(files, config):
    """Add the pages that are not in docs/."""
    readme = (ROOT / "README.md").read_text("utf-8")
    pages = {page: (ROOT / source).read_text("utf-8") for source, page in WHOLE.items()}
    pages |= {page: part(readme, heading) for page, heading in PARTS.items()}
    for package, names in REFERENCE.items():
        listed = "".join(f"\n::: {package}.{name}\n" for name in names)
        pages[f"reference/{package}.md"] = f"# {package}\n\nWhat `from {package} import ...` gives.\n{listed}"
    for page, text in pages.items():
        files.append(File.generated(config, page, content=text, inclusion=InclusionLevel.INCLUDED))
    return files


def on_page_markdown(markdown, page, config, files):
    """Turn links within the repository into links within the site; where the site lacks a file, its words are left."""
    at = page.file.src_uri
    source = "README.md" if at in PARTS else {to: name for name, to in WHOLE.items()}.get(at, f"docs/{at}")
    pictures = {file.src_uri for file in files}

    def fitted(match):
        before, target, after = match.groups()
        path, mark, anchor = target.partition("#")
        if re.match(r"[a-z]+:", target) or (not path and at not in PARTS):
            return match[0]
        place = posixpath.normpath(posixpath.join(posixpath.dirname(source), path)) if path else "README.md"
        to = WHOLE.get(place, place.removeprefix("docs/"))
        if to not in pictures:
            return match[0] if before.startswith("!") else before[1:-2]
        return before + posixpath.relpath(to, posixpath.dirname(at) or ".") + mark + anchor + after

    return LINK.sub(fitted, markdown)
