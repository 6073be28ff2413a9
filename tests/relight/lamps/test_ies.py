"""relight.lamps.ies: symmetry, factors, and what is refused."""

import numpy as np
import pytest
from typed_lamps import parse_lamp

from relight.lamps.asked import Brightness, LampScale, resolve
from relight.lamps.ies import read_profile
from relight.lamps.photometry import axis_intensity, flux
from relight.lamps.shapes import ProfileLamp
from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import LARGEST_TEXT

HEADERS = {
    "1986": "ANY LUMINAIRE",
    "1991": "IESNA91\n[TEST] none\n[MANUFAC] nobody",
    "1995": "IESNA:LM-63-1995\n[TEST] none",
    "2002": "IESNA:LM-63-2002\n[TEST] none\n[ISSUEDATE] today",
}


def text(vertical, horizontal, candela, header="2002", multiplier=1.0, ballast=1.0, second=1.0, kind=1, tilt="NONE"):
    """candela: (horizontal, vertical), as files have them."""
    rows = "\n".join(" ".join(f"{each:g}" for each in row) for row in candela)
    return (
        f"{HEADERS[header]}\nTILT={tilt}\n1 1000 {multiplier:g} {len(vertical)} {len(horizontal)} {kind} 2 0 0 0\n"
        f"{ballast:g} {second:g} 60\n{' '.join(map(str, vertical))}\n{' '.join(map(str, horizontal))}\n{rows}\n"
    )


def written(tmp_path, content):
    path = tmp_path / "lamp.ies"
    path.write_text(content, "latin-1")
    return path


@pytest.mark.parametrize("header", HEADERS)
def test_an_even_lamp_of_100_candela(tmp_path, header):
    path = written(tmp_path, text([0, 90, 180], [0], [[100, 100, 100]], header))
    profile = read_profile(path)
    assert profile.candela == 100.0 and (profile.table == 1.0).all()
    assert profile.vertical_deg.tolist() == [0, 90, 180] and profile.horizontal_deg.tolist() == [0, 360]
    asked = parse_lamp(f"{path} at=1,2,3 target=1,0,3 turn=30")
    assert asked.brightness == Brightness(100.0, "candela") and isinstance(asked.shape, ProfileLamp)
    assert asked.shape.turn_deg == 30.0 and asked.shape.position == (1.0, 2.0, 3.0)
    lamp = resolve(asked, LampScale(1.0, 1.0, 0.01))
    # 100 cd all round are 400 pi lm; a picture of 100 cd/m^2 for white.
    assert flux(lamp) @ [0.2126, 0.7152, 0.0722] == pytest.approx(4.0 * np.pi)


def test_a_diffuse_lamp_has_pi_lumens_a_candela(tmp_path):
    angle = np.arange(0, 91, 2.5)
    path = written(tmp_path, text(angle, [0], [200.0 * np.cos(np.radians(angle))]))
    lamp = resolve(parse_lamp(f"{path} at=0,0,0 target=0,-1,0 color=white"), LampScale(1.0, 1.0, 1.0))
    assert axis_intensity(lamp) == pytest.approx([200.0] * 3, rel=1e-5)
    assert flux(lamp) == pytest.approx([200.0 * np.pi] * 3, rel=2e-3)  # between steps of 2.5 degrees it is linear


def value(profile, vertical, horizontal):
    row = profile.vertical_deg.tolist().index(vertical)
    return profile.candela * np.interp(horizontal % 360.0, profile.horizontal_deg, profile.table[row])


def test_what_symmetry_leaves_out_is_filled_in(tmp_path):
    quarter = read_profile(written(tmp_path, text([0, 90], [0, 45, 90], [[9, 1], [9, 2], [9, 3]])))
    for turn, candela in [(0, 1), (45, 2), (90, 3), (135, 2), (180, 1), (225, 2), (270, 3), (315, 2), (360, 1)]:
        assert value(quarter, 90, turn) == pytest.approx(candela), turn
    half = read_profile(written(tmp_path, text([0, 90], [0, 90, 180], [[9, 1], [9, 2], [9, 3]])))
    for turn, candela in [(0, 1), (90, 2), (180, 3), (270, 2), (300, 2 - 1 / 3)]:
        assert value(half, 90, turn) == pytest.approx(candela), turn
    across = read_profile(written(tmp_path, text([0, 90], [90, 180, 270], [[9, 1], [9, 2], [9, 3]])))
    for turn, candela in [(90, 1), (180, 2), (270, 3), (0, 2), (45, 1.5), (315, 2.5)]:
        assert value(across, 90, turn) == pytest.approx(candela), turn
    whole = read_profile(written(tmp_path, text([0, 90], [0, 90, 270, 360], [[9, 1], [9, 2], [9, 3], [9, 1]])))
    for turn, candela in [(0, 1), (90, 2), (180, 2.5), (270, 3), (315, 2)]:
        assert value(whole, 90, turn) == pytest.approx(candela), turn
    open_ended = read_profile(written(tmp_path, text([0, 90], [0, 120, 240], [[9, 1], [9, 2], [9, 3]])))
    for turn, candela in [(0, 1), (120, 2), (240, 3), (300, 2)]:
        assert value(open_ended, 90, turn) == pytest.approx(candela), turn
    for profile in (quarter, half, across, whole, open_ended):
        assert profile.horizontal_deg[0] == 0.0 and profile.horizontal_deg[-1] == 360.0
        assert (profile.table[:, 0] == profile.table[:, -1]).all()


def test_light_that_goes_up_begins_there(tmp_path):
    profile = read_profile(written(tmp_path, text([90, 180], [0], [[50, 100]])))
    at = np.interp([0.0, 45.0, 89.99, 90.0, 135.0, 180.0], profile.vertical_deg, profile.table[:, 0])
    assert at == pytest.approx([0.0, 0.0, 0.0, 0.5, 0.75, 1.0])


def test_factors(tmp_path):
    three = {"multiplier": 2.0, "ballast": 0.9, "second": 0.5}
    assert read_profile(written(tmp_path, text([0, 90], [0], [[10, 5]], **three))).candela == pytest.approx(18.0)
    # Until 1991 the second one is the ballast's too.
    assert read_profile(written(tmp_path, text([0, 90], [0], [[10, 5]], "1991", **three))).candela == pytest.approx(9.0)


def test_numbers_run_over_lines_and_end_as_dos_has_them(tmp_path):
    plain = text([0, 90], [0], [[10, 5]])
    head, _, numbers = plain.partition("TILT=NONE\n")
    broken = head + "TILT = none\r\n" + "\r\n".join(numbers.split()) + "\r\n\x1a"
    assert read_profile(written(tmp_path, broken)).candela == read_profile(written(tmp_path, plain)).candela


@pytest.mark.parametrize("words", ["Tilting spot, 10W", "TILT 45 DEG MAX", "Tilt=adjustable, 0 to 30", "tilted = yes"])
def test_free_lines_may_begin_with_the_word(tmp_path, words):
    plain = text([0, 90], [0], [[10, 5]], "1986")
    first, more = plain.replace("ANY LUMINAIRE", words), plain.replace("TILT=NONE", f"{words}\nTILT=NONE")
    for content in (first, more):
        assert read_profile(written(tmp_path, content)).candela == read_profile(written(tmp_path, plain)).candela


GOOD = text([0, 90], [0], [[10, 5]])


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "no line TILT="),
        ("a picture\n", "no line TILT="),
        (text([0, 90], [0], [[1, 1]]).replace("TILT=NONE", "Tilting"), "no line TILT="),
        (text([0, 90], [0], [[1, 1]], tilt="INCLUDE"), "expected TILT=NONE, found TILT=INCLUDE"),
        (text([0, 90], [0], [[1, 1]], kind=2), "type B, expected C"),
        (text([0, 90], [0], [[1, 1]], kind=3), "type A, expected C"),
        (text([0, 90], [0], [[1, 1]], kind=7), "photometric type is 7"),
        (GOOD.replace("10 5", "10"), "announces 18 numbers, found 17"),
        (GOOD + "7", "announces 18 numbers, found 19"),
        (GOOD.replace("10 5", "10 x"), "expected numbers after TILT, found x"),
        (GOOD.replace("10 5", "10 nan"), "found nan"),
        (GOOD.replace("10 5", "10 -5"), "candela go from -5"),
        (GOOD.replace("10 5", "0 0"), "gives no light"),
        (GOOD.replace("1 1000 1 2 1", "1 1000 1 2e9 1e9"), "announces 2000000003000000000"),
        (GOOD.replace("1 1000 1 2 1", "1 1000 1 2.5 1"), "announces 2.5 vertical"),
        (GOOD.replace("1 1000 1 2 1", "1 1000 1 0 0"), "announces 0 vertical"),
        (GOOD.replace("\n0 90\n", "\n90 0\n"), "expected rising angles"),
        (GOOD.replace("\n0 90\n", "\n0 190\n"), "expected rising angles from 0 to 180"),
        (text([0, 90], [0, 45], [[1, 1], [1, 1]]), "end at 45, expected 0, 90, 180 or 360"),
        (text([0, 90], [30, 90], [[1, 1], [1, 1]]), "begin at 30"),
        ("IESNA91\nTILT=NONE\n1 2 3\n", "ends after 3 numbers"),
    ],
)
def test_what_is_no_profile_is_refused_in_one_line(tmp_path, content, says):
    with pytest.raises(InputError) as caught:
        read_profile(written(tmp_path, content))
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_too_large_is_not_read(tmp_path):
    path = tmp_path / "large.ies"
    with open(path, "wb") as file:
        file.truncate(LARGEST_TEXT + 1)
    with pytest.raises(InputError, match="over 64 MB"):
        read_profile(path)
