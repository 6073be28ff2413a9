"""The curve of a plan as a picture: what accuracy costs in time for one scene and light, with the choice on it."""

import os
from typing import TYPE_CHECKING

from splat2mesh.base.outputs import staged_file

from ..options import PICTURE_SIZE
from .plan import percent

if TYPE_CHECKING:
    from .plan import Plan

DOTS_PER_INCH = 100

LINE, CHOICE = "#1f5fa8", "#c22f2f"


def plot_plan(path: str | os.PathLike[str], plan: "Plan", title: str) -> None:
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
