"""Every reader against damaged files, lying headers and what is no file: read or refused in one line, nothing else.

The long attack, in processes with limits on time and memory, is `scripts/bench attack`.
"""

import resource
import time
import warnings

import pytest
from attacks import READERS, SUMMED, Attack, attacks_of, content_of, damaged, whole_files
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from splat2mesh.base.errors import InputError

LIES_AND_DAMAGE = 24
"""Inputs of each kind beside those that hypothesis draws."""

COSTLY = ("MB of zeros", "splats", "repeated_without_end")
"""What takes long to make rather than to refuse is left to the long attack."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return whole_files(tmp_path_factory.mktemp("whole"))


def outcome(kind, attack, folder):
    """None where it was refused, else a digest of what was read."""
    path = attack.write(folder)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return content_of(READERS[kind](path))
    except InputError as error:
        assert str(error) and "\n" not in str(error)
        return None


@pytest.mark.parametrize("kind", sorted(READERS))
def test_lies_and_what_is_no_file(whole, tmp_path, kind):
    begun, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for number, attack in enumerate(attacks_of(kind, whole[kind], LIES_AND_DAMAGE, seed=1)):
        if not attack.label.endswith(COSTLY):
            found = outcome(kind, attack, tmp_path / str(number))
            assert found is None or attack.summed in (None, found), attack.label
    assert time.process_time() - begun < 30.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1 << 20  # KiB: a gigabyte


@pytest.mark.parametrize("kind", sorted(READERS))
@seed(19)
@settings(max_examples=12, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_damage_of_all_sorts(whole, tmp_path_factory, kind, data):
    import numpy as np

    files, entry = whole[kind]
    name = data.draw(st.sampled_from(sorted(name for name in files if files[name])))
    content, label = damaged(files[name], np.random.default_rng(data.draw(st.integers(0, 2**32))))
    folder = tmp_path_factory.mktemp("damaged")
    found = outcome(kind, Attack(label, files | {name: content}, entry), folder / "case")
    if kind in SUMMED and found is not None:
        assert found == outcome(kind, Attack("whole", files, entry), folder / "whole"), (name, label)


def test_whole_files_are_read(whole, tmp_path):
    for kind, (files, entry) in whole.items():
        assert outcome(kind, Attack("whole", files, entry), tmp_path / kind) is not None, kind
