"""The frontier's tables and its plot, from what `scripts/frontier` measured and keeps in frontier.json."""

import numpy as np

COLORS = {
    "raytraced": "#1f5fa8",
    "neural-gash": "#8a3ea8",
    "analytic": "#3a8f4d",
    "blinn-phong": "#9a9a9a",
}
PLAN_COLOR = "#c22f2f"
PLAN_LABEL = {"textcoords": "offset points", "color": PLAN_COLOR, "weight": "bold"}


def label(row):
    """A setting of the grid, in short."""
    suns = f", suns {row['suns']:g}" if row["suns"] else ""
    bounces = f", bounces {row['bounce_rays']}" if row["bounce_rays"] else ""
    return f"{row['method']} {row['bands']}, {row['rays']}{suns}{bounces}"


def print_plans(found, report):
    """A row for each plan, and how good they are."""
    plans = found["plans"]
    columns = {"scene": "<14", "light": "<9", "tolerance": "g", "plan": "<36"}
    columns |= dict.fromkeys(("predicted", "checked", "true"), ".2%")
    columns |= dict.fromkeys(("work", "work_predicted", "planning"), ".0f")
    columns |= {"cheapest": "<36", "cheapest_work": ".0f", "ratio": ".2f"}
    table = report.table("plans, works in shadow rays of bare Embree a vertex", **columns)
    for row in plans:
        table.add(**row)
    kept = sum(row["true"] <= row["tolerance"] for row in plans)
    ratios = [row["ratio"] for row in plans if row["ratio"]]
    report.note(f"\n{kept} of {len(plans)} are within their tolerance.")
    if ratios:
        over = f"above 3 in {sum(ratio > 3 for ratio in ratios)} of {len(ratios)}"
        middle = f"median {np.median(ratios):.2f}, most {max(ratios):.2f}, {over}"
        report.note(f"Work over that of the cheapest: {middle}.")
    off = np.exp(np.abs(np.log([row["work_predicted"] / row["work"] for row in plans])))
    report.note(f"Work predicted over true: within a factor of {np.median(off):.2f} in half, {off.max():.2f} in all.")


def means(found):
    """Geometric means over scenes and lights: {(method, bands, rays, suns, bounces): (work, error)}, and of plans.

    Where light does not bounce, a setting with bounces is the one without.
    """
    places = {(row["scene"], row["light"]) for row in found["grid"]}
    by_key = {}
    for row in found["grid"]:
        by_key.setdefault(tuple(row[key] for key in ("method", "bands", "rays", "suns", "bounce_rays")), {})[
            row["scene"], row["light"]
        ] = max(row["work"], 1e-9), max(row["error"], 1e-6)
    grid = {}
    for key, there in by_key.items():
        every = {**by_key.get((*key[:4], 0), {}), **there}
        if set(every) == places:
            grid[key] = np.exp(np.log(list(every.values())).mean(axis=0))
    plans = {}
    for row in found["plans"]:
        plans.setdefault(row["tolerance"], []).append((row["work"], max(row["true"], 1e-6)))
    return grid, {tolerance: np.exp(np.log(values).mean(axis=0)) for tolerance, values in plans.items()}


def frontier(grid):
    """[(key, work, error)] of what nothing quicker beats."""
    found = []
    for key, (work, off) in sorted(grid.items(), key=lambda item: item[1][0]):
        if not found or off < found[-1][2]:
            found.append((key, work, off))
    return found


def print_frontier(found, report):
    """A row for each setting that nothing quicker beats, and for each tolerance."""
    grid, plans = means(found)
    columns = {"method": "<18", "bands": "<6", "rays": "<6", "suns": "<6", "bounce_rays": "<12"}
    table = report.table("frontier: work in rays a vertex", **columns, work=".1f", error=".2%")
    for (method, bands, rays, suns, bounce_rays), work, off in frontier(grid):
        row = {"method": method, "bands": bands, "rays": rays, "suns": suns, "bounce_rays": bounce_rays}
        table.add(**row, work=work, error=off)
    for tolerance, (work, off) in plans.items():
        table.add(method=f"plan of {tolerance:g}", work=work, error=off)


def draw(found, path):
    """One plot of the means: log time, log error."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    grid, plans = means(found)
    unit = 1e-9 * np.exp(np.mean(np.log([each["bare_ns_per_ray"] for each in found["scenes"].values()])))
    figure, axes = plt.subplots(figsize=(9.5, 6.2), dpi=130)
    for method, color in COLORS.items():
        points = {key: value for key, value in grid.items() if key[0] == method}
        if points:
            axes.scatter(*np.array(list(points.values())).T, s=16, color=color, alpha=0.5, linewidths=0)
            first = min(points.values(), key=lambda value: value[0])
            aside = {"xytext": (-7, -4), "ha": "right"} if method == "raytraced" else {"xytext": (6, 6)}
            axes.annotate(method, first, textcoords="offset points", color=color, weight="bold", **aside)
    steps = np.array([each[1:] for each in frontier(grid)])
    axes.plot(*steps.T, color="#333333", lw=1.2, zorder=3)
    middle = steps[min(1, len(steps) - 1)]
    axes.annotate("best fixed settings", middle, (10, 4), textcoords="offset points", color="#333333")
    axes.plot(*np.array(list(plans.values())).T, "*-", color=PLAN_COLOR, ms=15, zorder=5, mec="white", mew=0.8)
    for tolerance, place in plans.items():
        written = {"textcoords": "offset points", "ha": "right", "color": PLAN_COLOR, "weight": "bold"}
        axes.annotate(f"--tolerance {tolerance:g}", place, (-9, -9), fontsize=9, **written)
    axes.set(xscale="log", yscale="log", ylabel="relative error of exit radiance")
    axes.set_xlabel("work per vertex, in shadow rays of bare Embree")
    axes.yaxis.set_major_formatter(lambda value, _: f"{100 * value:g}%")
    axes.grid(color="#dddddd", lw=0.7)
    axes.set_axisbelow(True)
    axes.spines["right"].set_visible(False)

    def turned_over(values):
        return 1.0 / np.maximum(values, 1e-12) / unit

    axes.secondary_xaxis("top", functions=(turned_over, turned_over)).set_xlabel(
        f"vertices per second and processor, where such a ray takes {1e9 * unit:.0f} ns"
    )
    lights = len({row["light"] for row in found["grid"]})
    axes.set_title(f"Error against work, geometric means over {len(found['scenes'])} scenes under {lights} lights")
    figure.tight_layout()
    figure.savefig(path)


def draw_panels(panels, path):
    """A plot for each panel of `frontier_places`: log work, log error, the grid, what nothing quicker beats, plans."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator

    across = 2 if len(panels) == 4 else min(3, len(panels))
    down = -(-len(panels) // across)
    figure, axes = plt.subplots(down, across, figsize=(4.6 * across, 3.8 * down), dpi=110, squeeze=False)
    for spot, panel in zip(axes.flat, panels, strict=False):
        rows = [row for row in panel["rows"] if row["error"] > 0.0]
        fixed, plans = ([row for row in rows if row["plan"] == kind] for kind in (False, True))
        best, least = [], np.inf
        for row in sorted(fixed, key=lambda row: row["work"]):
            if row["error"] < least:
                best.append((row["work"], row["error"]))
                least = row["error"]
        spot.scatter(*_places(fixed), s=16, color=COLORS["raytraced"], alpha=0.5, linewidths=0)
        spot.plot(*np.array(best).T, color="#333333", lw=1.2, zorder=3)
        spot.plot(*_places(plans), "*-", color=PLAN_COLOR, ms=12, zorder=5, mec="white", mew=0.8)
        for name, row in _labels(plans):
            spot.annotate(name, (row["work"], row["error"]), (6, 4), fontsize=8, **PLAN_LABEL)
        spot.set(xscale="log", yscale="log", title=f"{panel['scene']}, {panel['panel']}")
        for part in (spot.yaxis.set_major_formatter, spot.yaxis.set_minor_formatter):
            part(lambda value, _: f"{100 * value:g}%")
        spot.xaxis.set_minor_formatter("")
        decades = np.ptp(np.log10(spot.get_ylim()))
        spot.yaxis.set_minor_locator(LogLocator(subs=(2, 5) if decades > 0.7 else range(2, 10)))
        spot.tick_params(which="minor", labelsize=6)
        spot.grid(color="#dddddd", lw=0.7)
        spot.set_axisbelow(True)
        spot.spines[["top", "right"]].set_visible(False)
    for spot in axes.flat[len(panels) :]:
        spot.remove()
    figure.supxlabel("work per vertex, in shadow rays of bare Embree", fontsize=10)
    figure.supylabel("relative error", fontsize=10)
    figure.tight_layout()
    figure.savefig(path)


def _labels(plans):
    """[(text, row)]: the tolerances of plans, those that chose the same in one label; what gloss does by default."""
    found = {}
    for row in plans:
        tolerance, _, setting = row["setting"].partition(": ")
        name = f"{100 * float(tolerance):g}%" if setting else row["setting"]
        found.setdefault((setting, round(row["error"], 4)), (row, []))[1].append(name)
    return [(", ".join(names), row) for row, names in found.values()]


def _places(rows):
    return np.array([(row["work"], row["error"]) for row in rows]).T.reshape(2, -1)
