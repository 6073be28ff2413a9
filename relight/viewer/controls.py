"""Keys, sliders and mouse of a session: one table for the window, its help, docs/options.md and the tests."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from ..transfer.settings import BOUNCES, SHADOWS, SUN
from .state import MODES

if TYPE_CHECKING:
    from .session import Session


ANGLE_STEP_DEG = 5.0
EXPOSURE_STEP_EV = 0.25
TOLERANCE_STEP = 2.0**0.5


Action = Callable[[Any], None]
"""Called with the Window."""


class Control(NamedTuple):
    """One key. key: a VTK key symbol. text: for the help. act: called with the window.

    chip: of a Session, the text of a button that does the same, or None without one. row: where the button stands,
    "modes", "choices", "hand" while the captured light is set by hand, or "both" of the last two. lit: of a Session, 1
    where the button is shown as switched on, 0.5 where that has no effect.
    there: of a Session, whether there is anything to control; otherwise button and help are hidden.
    """

    key: str
    text: str
    act: Action
    chip: Callable[["Session"], str] | None = None
    row: str = ""
    lit: Callable[["Session"], float] = lambda session: 0
    there: Callable[["Session"], bool] = lambda session: True


class Slider(NamedTuple):
    """One slider. field: of the State. text: its name on screen. show: a value as text. logarithmic: its scale. there:
    as of a Control. read, write: of a Session and of a Window, what is set; that field of the State without."""

    field: str
    text: str
    show: Callable[[float], str]
    logarithmic: bool = False
    there: Callable[["Session"], bool] = lambda session: True
    read: Callable[[Any], float] | None = None
    write: Callable[[Any, float], None] | None = None

    @property
    def of_hand(self) -> bool:
        """Whether it sets the captured light by hand."""
        return self.field.startswith("hand_")


def _change(**changes: Any) -> Action:
    """An action that sets fields of the state; callables are given the state first."""

    def act(window: Any) -> None:
        state = window.session.state
        window.session.change(**{name: value(state) if callable(value) else value for name, value in changes.items()})

    return act


def _toggle(field: str) -> Action:
    return _change(**{field: lambda state: not getattr(state, field)})


def _step(field: str, step: float) -> Action:
    return _change(**{field: lambda state: getattr(state, field) + step})


def _next(field: str, step: int) -> Action:
    def act(window: Any) -> None:
        names = window.session.choices[field]
        place = names.index(getattr(window.session.state, field)) + step
        window.session.change(**{field: names[place % len(names)]})

    return act


def _effect(key: str, name: str, text: str) -> Control:
    def lit(session: "Session") -> float:
        return (name in session.effects) * (1.0 if name in session.answers.called_for else 0.5)

    toggle = _change(effects=lambda state: state.effects ^ {name})
    return Control(key, text, toggle, lambda session: name, "choices", lit)


def _mode(key: str, name: str) -> Control:
    def lit(session: "Session") -> float:
        return session.state.mode == name and session.state.tool != "hand"

    change = _change(mode=name, tool=lambda state: state.tool.replace("hand", ""))
    return Control(key, MODES[name], change, lambda s: name.title(), "modes", lit)


def _has(name: str) -> Callable[["Session"], bool]:
    """Whether a Session has what it may be without: its splats, lamps, objects or hand."""
    return lambda session: getattr(session, name) is not None


def _mixes(session: "Session") -> bool:
    return session.lamps is not None and (session.uses("lamps") or session.mixture is not None)


def _has_selected(session: "Session") -> bool:
    return session.lamps is not None and session.uses("lamps") and session.lamps.selected is not None


def _uses(tool: str) -> Callable[["Session"], bool]:
    """Whether a Session uses a tool."""
    return lambda session: session.uses(tool)


_by_hand, _parting = _uses("hand"), _uses("parts")


def _hand_slider(name: str, text: str, show: Callable[[float], str]) -> Slider:
    """A slider of a field of the HandLight."""
    return Slider(
        f"hand_{name}",
        text,
        show,
        there=_by_hand,
        read=lambda session: getattr(session.hand.hand, name),
        write=lambda window, value: window.session.hand.change(**{name: value}),
    )


def _part_slider(name: str, text: str, show: Callable[[float], str]) -> Slider:
    """A slider of the light of a PartMade."""
    return Slider(
        f"part_{name}",
        text,
        show,
        there=_parting,
        read=lambda session: getattr(session.parts.made, name),
        write=lambda window, value: window.mouse.parts.light_to(name, value),
    )


CONTROLS = (
    *(_mode(str(number), name) for number, name in enumerate(MODES, 1)),
    _effect("s", SHADOWS, "shadows on, off: sun and bounces need them"),
    _effect("u", SUN, "sun on, off: concentrated light with sharp shadows"),
    _effect("o", BOUNCES, "bounces on, off: light between surfaces"),
    Control("e", "next light", _next("environment", 1), lambda s: s.state.environment, "choices"),
    Control("w", "previous light", _next("environment", -1)),
    Control("a", "next albedo", _next("albedo", 1), lambda s: f"albedo {s.state.albedo}", "choices"),
    Control("m", "next method: as planned, the network, no shadows", _next("method", 1),
            lambda s: s.state.method, "choices", there=lambda session: len(session.choices["method"]) > 1),
    Control("b", "before and after: capture left of the line", _toggle("split"), lambda s: "split", "both",
            lambda s: s.state.split),
    Control("k", "sky behind the scene on, off", _toggle("sky"), lambda s: "sky", "choices", lambda s: s.state.sky),
    Control("g", "mesh or splat", _toggle("mesh"), lambda s: "mesh", "choices",
            lambda s: s.state.mesh, _has("splats")),
    Control("l", "captured lamps off, on", _change(lamps=lambda s: float(s.lamps == 0.0)), lambda s: "lamps", "choices",
            lambda s: s.state.lamps > 0.0, lambda session: session.has_lamps),
    Control("t", "lamps: click adds one, drag moves it", lambda window: window.mouse.lamps.toggle(),
            lambda s: "add lamps", "choices", _uses("lamps"), _has("lamps")),
    Control("c", "next colour of the lamp", lambda window: window.mouse.lamps.next_color(), there=_has("lamps")),
    Control("d", "delete the lamp", lambda window: window.mouse.lamps.remove(), there=_has("lamps")),
    Control("z", "undo a change of lamps, objects or a part", lambda window: window.mouse.lamps.step_back(),
            there=lambda session: session.timeline.kept),
    Control("y", "redo", lambda window: window.mouse.lamps.step_back(again=True),
            there=lambda session: session.timeline.kept),
    Control("j", "save the lamps as lamps.json", lambda window: window.mouse.lamps.save(), there=_has("lamps")),
    Control("6", "objects: drag moves one, with shift up and down", lambda window: window.mouse.objects.toggle(),
            lambda s: "move objects", "choices", _uses("objects"), _has("objects")),
    Control("7", "turn the object clockwise", lambda window: window.mouse.objects.turn(-ANGLE_STEP_DEG),
            there=_has("objects")),
    Control("8", "turn the object counter-clockwise", lambda window: window.mouse.objects.turn(ANGLE_STEP_DEG),
            there=_has("objects")),
    Control("9", "captured light by hand: drag its sun, right drag too", lambda window: window.mouse.hand.toggle(),
            lambda s: "captured light", "both", _uses("hand"), _has("hand")),
    Control("apostrophe", "next of the likely captured lights", lambda window: window.mouse.hand.next_light(),
            lambda s: "next light", "hand", there=_has("hand")),
    Control("slash", "captured sun: click a shadow's edge, then what casts it", lambda window: window.mouse.hand.ask(),
            lambda s: "point at a shadow", "hand", there=_has("hand")),
    Control("0", "keep the captured light: the session and commands use it", lambda window: window.mouse.hand.keep(),
            lambda s: "keep", "hand", lambda s: s.hand is not None and s.hand.kept == s.hand.setting, _has("hand")),
    Control("5", "parts: a click adds a surface, the slider says how much", lambda window: window.mouse.parts.toggle(),
            lambda s: "parts", "choices", _uses("parts"), _has("parts")),
    Control("Return", "keep the part: commands know it by its name", lambda window: window.mouse.parts.keep(),
            lambda s: "keep part", "choices", there=_parting),
    Control("space", "start, stop rotating the light", _toggle("turning"), lambda s: "turn", "choices",
            lambda s: s.state.turning),
    Control("Left", "turn the light clockwise", _step("angle_deg", -ANGLE_STEP_DEG)),
    Control("Right", "turn the light counter-clockwise", _step("angle_deg", ANGLE_STEP_DEG)),
    Control("Up", "brighter", _step("exposure_ev", EXPOSURE_STEP_EV)),
    Control("Down", "darker", _step("exposure_ev", -EXPOSURE_STEP_EV)),
    Control("minus", "smaller tolerance: slower, more accurate",
            _change(tolerance=lambda s: s.tolerance / TOLERANCE_STEP)),
    Control("equal", "larger tolerance: faster", _change(tolerance=lambda s: s.tolerance * TOLERANCE_STEP)),
    Control("p", "save a picture, without this panel", lambda window: window.save_picture()),
    Control("v", "record a rotation of the light", lambda window: window.record()),
    Control("x", "panel on, off", _toggle("panel")),
    Control("r", "reset everything", lambda window: window.reset()),
    Control("h", "this list on, off", _toggle("help"), lambda s: "keys", "modes", lambda s: s.state.help),
    Control("q", "quit", lambda window: window.quit()),
)  # fmt: skip

SLIDERS = (
    Slider("angle_deg", "Light", lambda value: f"{value:.0f}\N{DEGREE SIGN}"),
    Slider("exposure_ev", "Exposure", lambda value: f"{value:+.2f} EV"),
    Slider("tolerance", "Tolerance", lambda value: f"{100 * value:.2g} %", True),
    Slider("lamps", "Lamps", lambda value: f"x {value:.2f}", there=lambda session: session.has_lamps),
    Slider("captured", "Captured", lambda value: f"x {value:.2f}", there=_mixes,
           read=lambda session: session.lamps.state.captured,
           write=lambda window, value: window.mouse.lamps.do(lambda board: board.dim(value, merge="captured"))),
    Slider("lamp_ev", "Lamp", lambda value: f"{value:+.1f} EV", there=_has_selected,
           read=lambda session: session.lamps.selected_ev,
           write=lambda window, value: window.mouse.lamps.do(lambda board: board.set_selected_ev(value))),
    Slider("part_reach", "Part", lambda value: f"{100 * value:.0f} %", True, _parting,
           lambda session: session.parts.reach,
           lambda window, value: window.mouse.parts.reach_to(value)),
    _part_slider("exposure_ev", "Part's light", lambda value: f"{value:+.2f} EV"),
    _part_slider("warmth", "Its warmth", lambda value: f"{value:+.2f}"),
    _hand_slider("azimuth_deg", "Sun at", lambda value: f"{value:.0f}\N{DEGREE SIGN}"),
    _hand_slider("height_deg", "Height", lambda value: f"{value:.0f}\N{DEGREE SIGN}"),
    _hand_slider("sun_share", "Sun's part", lambda value: f"{100 * value:.0f} %"),
    _hand_slider("brightness_ev", "Brightness", lambda value: f"{value:+.2f} EV"),
    _hand_slider("warmth", "Warmth", lambda value: f"{value:+.2f}"),
    _hand_slider("green", "Green", lambda value: f"{value:+.2f}"),
)  # fmt: skip

MOUSE = (
    ("left drag", "look around"),
    ("right drag", "turn the light"),
    ("mid drag", "move sideways"),
    ("wheel", "nearer, farther"),
)

KEY_NAMES = {
    "minus": "-",
    "equal": "=",
    "apostrophe": "'",
    "slash": "/",
}
"""Labels of VTK's key symbols on a keyboard, where they differ."""


def key_name(control: Control) -> str:
    """The label of a key on a keyboard."""
    return KEY_NAMES.get(control.key, control.key.lower())
