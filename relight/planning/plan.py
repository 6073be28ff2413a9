"""A plan: the work, its predicted error and time, and the reasons; in memory, as JSON, as a table, as a picture."""

import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.outputs import staged_file

from ..options import PICTURE_SIZE
from ..transfer.settings import Settings


@dataclass
class Plan:
    """The settings that a scene and a light need, with predicted error and time.

    settings: Settings. error: predicted relative L2 of exit radiance over the scene, for every rotation of the
    light. seconds: predicted, for the scene and the requested number of lights. sun_count: how many. tolerance,
    budget_s: as asked, of LightingOptions; None for the other. vertices, rays: size of the sample, 0 without.
    contributions: [(effect, error without it or None, decision)]. curve: [(seconds, error, Settings)] that nothing
    quicker beats. planning_s: what the plan took. checked: the error as measured on the sample after the work.
    choice: the candidates, which give that error for Settings and a transfer (S, K) of the sample's `rows`, and
    their contributions; None in a plan kept from before.
    """

    settings: Settings
    error: float
    seconds: float
    sun_count: int
    tolerance: float | None
    budget_s: float | None
    vertices: int
    rays: int
    contributions: list[tuple[str, float | None, str]]
    curve: list[tuple[float, float, Settings]]
    planning_s: float
    checked: float | None = None
    choice: Any = field(default=None, repr=False)
    rows: NDArray[np.integer] | None = field(default=None, repr=False)

    def as_dict(self) -> dict[str, Any]:
        """JSON-clean, for the report; `from_dict` reads it."""
        return {
            "settings": _settings_dict(self.settings),
            "predicted_error": _rounded(self.error),
            "checked_error": _rounded(self.checked),
            "predicted_seconds": _rounded(self.seconds),
            "suns": self.sun_count,
            "tolerance": self.tolerance,
            "budget_seconds": self.budget_s,
            "sample": {"vertices": self.vertices, "rays": self.rays, "seconds": _rounded(self.planning_s)},
            "contributions": [
                {"effect": effect, "error_without": _rounded(error), "decision": decision}
                for effect, error, decision in self.contributions
            ],
            "curve": [
                {"seconds": _rounded(seconds), "error": _rounded(error), "settings": _settings_dict(settings)}
                for seconds, error, settings in self.curve
            ],
        }

    @classmethod
    def from_dict(cls, kept: dict[str, Any]) -> "Plan":
        """A plan from its dict. Raises KeyError or TypeError for anything else."""
        return cls(
            settings=_settings_from(kept["settings"]),
            error=kept["predicted_error"],
            seconds=kept["predicted_seconds"],
            sun_count=kept["suns"],
            tolerance=kept["tolerance"],
            budget_s=kept["budget_seconds"],
            vertices=kept["sample"]["vertices"],
            rays=kept["sample"]["rays"],
            planning_s=kept["sample"]["seconds"],
            contributions=[(row["effect"], row["error_without"], row["decision"]) for row in kept["contributions"]],
            curve=[(row["seconds"], row["error"], _settings_from(row["settings"])) for row in kept["curve"]],
            checked=kept["checked_error"],
        )

    def table(self) -> list[str]:
        """The plan as lines of text: decisions, then the curve, thinned to a dozen steps and the choice."""
        wish = f"tolerance {self.tolerance:g}" if self.budget_s is None else f"budget {self.budget_s:g} s"
        lines = [f"plan for {wish}: {self.settings}"]
        if not self.rays:
            lines.append("  not measured: on so few vertices a sample costs more than it saves")
            return [
                *lines,
                f"  error at most {percent(self.error)} on generated scenes; predicted: {self.seconds:.2f} s",
            ]
        lines.append(f"  {'effect':<15}{'error without':>14}  decision")
        for effect, error, decision in self.contributions:
            without = "-" if error is None else percent(error)
            lines.append(f"  {effect:<15}{without:>14}  {decision}")
        checked = "" if self.checked is None else f", {percent(self.checked)} checked on the sample"
        lines.append(f"  predicted: error {percent(self.error)}{checked}; {self.seconds:.2f} s")
        within = "" if self.budget_s is None else " of the budget"
        sample = f"{self.vertices} vertices and {self.rays:,} rays"
        lines.append(f"  measured on {sample} in {self.planning_s:.2f} s{within}")
        lines += ["accuracy against time", f"  {'seconds':>9}{'error':>9}"]
        others = [row for row in self.curve if row[2] != self.settings]
        chosen = self.seconds, self.error, self.settings
        for seconds, error, settings in sorted([*_thinned(others, 13), chosen], key=lambda row: row[0]):
            mark = " <" if settings == self.settings else ""
            lines.append(f"  {seconds:9.3f}{percent(error):>9}  {settings}{mark}")
        return lines


DOTS_PER_INCH = 100

LINE, CHOICE = "#1f5fa8", "#c22f2f"

MOST_SHOWN = 10.0
"""Error above which a table gives no figure: in the dark, where any light is an error, it gives the darkness."""


def percent(error: float) -> str:
    """An error as tables show it: "1.25%", "> 1000%"."""
    return f"{error:.2%}" if error < MOST_SHOWN else f"> {MOST_SHOWN:.0%}"


_KEYS = {"sun_tolerance": "suns", "bounce_tolerance": "bounces"}
"""Fields of Settings that reports have always called otherwise."""


def _settings_dict(settings: Settings) -> dict[str, Any]:
    values = {name: list(value) if isinstance(value, tuple) else value for name, value in settings._asdict().items()}
    return {_KEYS.get(name, name): value for name, value in values.items()}


def _settings_from(kept: dict[str, Any]) -> Settings:
    values: dict[str, Any] = {name: kept[_KEYS.get(name, name)] for name in Settings._fields}
    tuples = {name: tuple(value) for name, value in values.items() if isinstance(value, list)}
    return Settings(**{**values, **tuples})


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")


def _thinned(rows: list[Any], count: int) -> list[Any]:
    """At most so many rows, evenly, the first and the last among them."""
    keep: Any = np.unique(np.linspace(0, len(rows) - 1, min(count, len(rows))).round().astype(int)) if rows else []
    return [rows[at] for at in keep]


def plot_plan(path: str | os.PathLike[str], plan: Plan, title: str) -> None:
    """Write the curve of a Plan as a PNG: seconds against relative error, both logarithmic, and the chosen settings.

    Every point is a setting that nothing quicker beats.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator

    width, height = PICTURE_SIZE
    figure = Figure((width / DOTS_PER_INCH, height / DOTS_PER_INCH), dpi=DOTS_PER_INCH, layout="constrained")
    axes = figure.add_subplot(xscale="log", yscale="log", xlabel="seconds", ylabel="relative error", title=title)
    curve = sorted(plan.curve, key=lambda row: row[0])
    axes.step([row[0] for row in curve], [row[1] for row in curve], where="post", color=LINE, lw=1.5)
    axes.plot([row[0] for row in curve], [row[1] for row in curve], "o", color=LINE, ms=3)
    axes.plot(plan.seconds, plan.error, "o", color=CHOICE, ms=9, label=f"chosen: {plan.settings}")
    if plan.tolerance is not None:
        axes.axhline(plan.tolerance, color=CHOICE, lw=0.8, ls="--", label=f"tolerance {percent(plan.tolerance)}")
    if plan.budget_s is not None:
        left = max(plan.budget_s - plan.planning_s, 0.0)
        axes.axvline(left, color=CHOICE, lw=0.8, ls="--", label=f"budget {plan.budget_s:g} s, less planning")
    for axis, text in ((axes.xaxis, "{:g}".format), (axes.yaxis, "{:.2%}".format)):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _, text=text: text(value)))
        axis.set_minor_formatter(FuncFormatter(lambda value, _: ""))
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right", frameon=False)
    with staged_file(path) as partial:
        figure.savefig(partial, format="png")
