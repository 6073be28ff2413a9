"""The register: every known format is read or says what to do; what is written comes back; documents agree."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from splat_samples import make_splats, store

from splat2mesh.base.errors import InputError
from splat2mesh.splats.facts import FileFacts
from splat2mesh.splats.formats import WRITERS, kind_of, read_splats, write_splats
from splat2mesh.splats.formats.register import BY_KIND, FORMATS, KINDS, looks_like_splat

CONVENTIONS = Path(__file__).parents[4] / "docs" / "conventions.md"


def test_every_format_is_read_and_written_or_says_why_not():
    assert len(BY_KIND) == len(FORMATS)
    for each in FORMATS:
        assert each.suffixes and all(suffix.startswith(".") for suffix in each.suffixes)
        assert (each.read is not None and each.write is not None) or each.instead, each.kind
        assert each.read is None or f".{each.suffixes[0].strip('.').split('.')[-1]}" in KINDS, each.kind
    assert list(WRITERS) == ["ply", "spz", "compressed.ply", "sog"]


@pytest.mark.parametrize("kind", [each.kind for each in FORMATS if each.read is None])
def test_a_known_format_that_is_not_read_is_named_with_what_to_do(tmp_path, kind):
    path = store(tmp_path, f"a{BY_KIND[kind].suffixes[0]}", b'{"some": "thing"}' * 9)
    with pytest.raises(InputError, match=re.escape(BY_KIND[kind].title)) as caught:
        read_splats(path)
    assert BY_KIND[kind].instead in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("antialiased", [None, True])
@pytest.mark.parametrize("kind", WRITERS)
def test_what_is_written_comes_back_with_its_tag(tmp_path, kind, antialiased):
    """Values within the steps of each format; `test_writers` holds them against other implementations."""
    splats = make_splats(600, 0 if kind == "sog" else 2)
    sh = np.clip(splats.sh / 8, -0.9, 0.9).astype(np.float32)
    splats = replace(splats, sh=sh, facts=FileFacts(antialiased=antialiased))
    write_splats(tmp_path / f"a.{kind}", splats, kind)
    found = read_splats(tmp_path / f"a.{kind}")
    assert kind_of(tmp_path / f"a.{kind}") == kind and looks_like_splat(tmp_path / f"a.{kind}")
    assert found.facts == splats.facts and len(found) == 600 and found.degree == splats.degree
    steps = {"ply": (0, 1e-5, 1e-6), "spz": (2e-6, 0.033, 0.015), "compressed.ply": (4e-3, 4e-3, 0.02)}
    means, scales, sh_step = steps.get(kind, (1e-3, 0.05, 0.02))
    np.testing.assert_allclose(found.means, splats.means, atol=means)
    np.testing.assert_allclose(np.log(found.scales), np.log(splats.scales), atol=scales)
    np.testing.assert_allclose(found.sh, splats.sh, atol=sh_step)
    np.testing.assert_allclose(found.opacities, splats.opacities, atol=1e-6 if kind == "ply" else 0.51 / 255)


def test_the_table_of_formats_in_the_documents():
    text = CONVENTIONS.read_text("utf-8")
    table = text[text.index("| format | read | written |") :].split("\n\n")[0].splitlines()[2:]
    rows = {cells[0]: cells[1:] for cells in ([cell.strip() for cell in line.strip("|").split("|")] for line in table)}
    assert list(rows) == [each.title for each in FORMATS]
    for each in FORMATS:
        read, written, _, frame, _ = rows[each.title]
        assert read.startswith("yes") == (each.read is not None), each.kind
        assert written.startswith("yes") == (each.write is not None), each.kind
        assert frame == (each.frame if each.read else ""), each.kind
