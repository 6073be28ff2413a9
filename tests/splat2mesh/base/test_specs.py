"""Texts of a head and name=value words, as `--lamp` and `--insert` take them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import LONGEST_SPEC, clip, parse_spec, plain

NAMES = st.text("abcxyz_", min_size=1, max_size=6)
VALUES = st.text("abc 1,.-", max_size=12).map(lambda text: " ".join(text.split()))


@settings(max_examples=200, deadline=None, database=None, derandomize=True)
@given(VALUES, st.dictionaries(NAMES, VALUES, max_size=5))
def test_what_was_joined_comes_apart_again(head, words):
    text = " ".join([head, *(f"{name}={value}" for name, value in words.items())])
    assert parse_spec(text) == (head, words)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("my statue.glb at=1, 2, 3 turn = 30", ("my statue.glb", {"at": "1, 2, 3", "turn": "30"})),
        ("at=1,2,3", ("", {"at": "1,2,3"})),
        ("", ("", {})),
    ],
)
def test_spaces_stand_in_paths_values_and_around_words(text, expected):
    assert parse_spec(text) == expected


@pytest.mark.parametrize(
    ("text", "says"), [("a at=1 at=2", "at: given twice"), ("a" * (LONGEST_SPEC + 1), "4097 letters, expected at most")]
)
def test_a_word_twice_and_long_texts_are_refused(text, says):
    with pytest.raises(InputError, match=says):
        parse_spec(text)


def test_messages_are_one_line_and_short():
    assert clip("a\n b") == "a b" and len(clip("a" * 99)) == 60
    assert plain(InputError("`radius`\n 0")) == "radius 0"
