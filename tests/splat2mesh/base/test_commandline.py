"""Command lines that meet people half way."""

import pytest

from splat2mesh.base.choices import check_choice, several
from splat2mesh.base.commandline import Parser, count, joined, share
from splat2mesh.base.errors import InputError


@pytest.mark.parametrize(
    ("given", "read"),
    [
        (["--up", "-y"], ["--up=-y"]),
        (["a.ply", "--rotate", "-30:30:10", "-q"], ["a.ply", "--rotate=-30:30:10", "-q"]),
        (["--rotate", "-.5"], ["--rotate=-.5"]),
        (["--up", "-q"], ["--up", "-q"]),
        (["--seed", "-1"], ["--seed", "-1"]),
        (["--up"], ["--up"]),
    ],
)
def test_a_value_may_begin_with_a_minus_where_the_option_takes_one(given, read):
    assert joined(given, ("--up", "--rotate")) == read


def test_words_are_known_in_any_case_and_near_ones_are_suggested():
    assert check_choice("env", "SunSet", ("studio", "sunset")) == "sunset"
    with pytest.raises(InputError, match=r"`env` snset: expected one of studio sunset; did you mean sunset\?$"):
        check_choice("env", "snset", ("studio", "sunset"))
    for other in ("xyzzy", 3, None):
        with pytest.raises(InputError, match=r"expected one of studio sunset$"):
            check_choice("env", other, ("studio", "sunset"))


def test_several_words_stand_apart_with_commas_or_in_options_given_again():
    kinds = ("glb", "png", "ply")
    assert several("formats", ["glb,png", "PLY", "glb"], kinds) == ("glb", "png", "ply")
    assert several("formats", [], kinds) == ()
    with pytest.raises(InputError, match=r"`formats` pgn: .*did you mean png\?"):
        several("formats", ["glb", "pgn"], kinds)
    with pytest.raises(InputError, match="`formats`: expected some of glb png ply"):
        several("formats", [","], kinds)


@pytest.mark.parametrize(("text", "value"), [("0.02", 0.02), ("1%", 0.01), (" 2.5 %", 0.025), (None, None)])
def test_shares_may_be_in_percent(text, value):
    assert share("--tolerance", text) == (None if value is None else pytest.approx(value, rel=1e-12))


@pytest.mark.parametrize(
    ("text", "message"),
    [("5", r"below 1.*did you mean 5%\?"), ("100%", "below 1, such as 0.02 or 2%$"), ("much", "such as 0.02, or 2%$")],
)
def test_what_is_no_share_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        share("--tolerance", text)


def test_a_nearly_right_option_is_reported_in_one_line(capsys):
    parser = Parser(prog="tool")
    parser.add_argument("--rotate")
    with pytest.raises(SystemExit) as exit_:
        parser.parse_args(["--rotte", "3"])
    assert exit_.value.code == 2
    assert capsys.readouterr().err == (
        "error: --rotte: no such option; did you mean --rotate?; tool --help shows all\n"
    )


@pytest.mark.parametrize("words", [["a", "--env", "b.exr", "c.exr"], ["a", "-e", "b.exr", "c.exr", "d.exr"]])
def test_a_second_value_is_reported_with_what_to_do_instead(capsys, words):
    parser = Parser(prog="tool")
    parser.add_argument("scene")
    parser.add_argument("-e", "--env", action="append")
    with pytest.raises(SystemExit) as exit_:
        parser.parse_args(words)
    assert exit_.value.code == 2
    message = f"{words[1]} takes one value, found b.exr and c.exr: give {words[1]} before each"
    assert capsys.readouterr().err == f"error: {message}; tool --help shows all\n"


@pytest.mark.parametrize("words", [["a", "b"], ["a", "--flag", "b"], ["a", "--env", "c", "--flag", "b"]])
def test_a_word_too_many_behind_nothing_is_no_second_value(capsys, words):
    parser = Parser(prog="tool")
    parser.add_argument("scene")
    parser.add_argument("--env")
    parser.add_argument("--flag", action="store_true")
    with pytest.raises(SystemExit):
        parser.parse_args(words)
    assert "unrecognized arguments: b;" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "value"), [("20000", 20_000), ("2k", 2000), ("1.5M", 1_500_000), (" 0.5K ", 500), ("0", 0)]
)
def test_counts_may_be_in_thousands_and_millions(text, value):
    assert count("--vertices", text) == value


@pytest.mark.parametrize("text", ["2kk", "k", "1.2345k", "1e5", "-3", "many", ""])
def test_what_is_no_count_is_refused(text):
    with pytest.raises(InputError, match=r"--vertices .*: expected a whole number, such as 20000, 20k or 1\.5M"):
        count("--vertices", text)
