"""Fit the numbers of the captured light: weights of cues and scales of their noise, on one part of the corpus.

A coordinate search over the logarithms of the numbers minimises the loss of relit colours against the known light, with
one gain for each colour, and a fifth of the loss without any gain. The choose and the test part are only scored.
"""

import json
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np

from relight.albedo import fitted, natural, posterior
from relight.albedo.evidence import Evidence, LitPlaces, SeenSky
from relight.albedo.refined import refined
from relight.sh import harmonics
from splat2mesh.scene.color import luminance, srgb_from_linear

from . import trained
from .captures import DIRECTIONS, harmonics_of, load

STEPS = {
    "distant": 3.0,
    "parallel": 2.0,
    "slanted": 2.0,
    "difference": 1.4,
    "distant_difference": 1.4,
    "sky": 3.0,
    "sky_noise": 1.5,
    "clipped": 3.0,
    "clipped_level": 1.4,
    "clipped_noise": 1.5,
    "parallel_slope": 4.0,
    "slanted_slope": 4.0,
    "albedo_spread": 1.5,
}
"""First factor on each number that is tried."""

PLAIN = 0.2
"""Weight of the loss without a gain."""

DIMMEST = 1e-3
"""Light that places receive at least where the median albedo is found."""

LEAST_GAIN = 0.005
"""Of the loss, in dB, for which a number is changed."""


def evidence_of(capture, numbers):
    """The Evidence of a capture, a dict of arrays of `captures`."""
    sky = None
    if "sky_seen" in capture:
        sky = SeenSky(capture["sky_log"], capture["sky_seen"], capture["sky_clipped"])
    fields = (capture[name] for name in ("sky", "directions", "captured", "bounced", "normals", "pairs", "weights"))
    return Evidence(LitPlaces(*fields), sky, numbers)


SURE = 0.8
"""Part of the captures whose loss lies within the doubt that is told."""


def estimated(capture, numbers, unrefined=False):
    """The image (64, 128, 3) of the estimated light, and the spread of its posterior."""
    evidence = evidence_of(capture, numbers)
    lights = posterior.lights_of(evidence, natural.natural_light())
    spread = posterior.spread(evidence, lights)
    lights = lights if unrefined else refined(evidence, lights)
    return posterior.mean_radiance(lights, DIRECTIONS).reshape(64, 128, 3), spread


def losses(capture, image):
    """(with a gain for each colour, without) dB lost against the known light, means over its new lights."""
    true = np.maximum(capture["seen_transfer"] @ capture["light"], 0.0) + capture["seen_bounced"]
    found = np.maximum(capture["seen_transfer"] @ harmonics_of(image), 0.0) + capture["seen_bounced"]
    good = true.min(axis=1) > 1e-3
    off = np.log(true[good]) - np.log(np.maximum(found[good], 1e-4))
    floor, lost = 10 ** (-posterior.CEILING_DB / 10), []
    for each in (off - np.median(off, axis=0), off):
        found = []
        for wanted in capture["relit"]:
            shown = np.clip(wanted[good] * np.exp(np.clip(each, -5.0, 5.0)), 0.0, 1.0)
            error = srgb_from_linear(shown.astype(np.float32)) - srgb_from_linear(np.clip(wanted[good], 0.0, 1.0))
            found.append(10 * np.log10(1.0 + np.square(error).mean() / floor))
        lost.append(float(np.mean(found)))
    return tuple(lost)


def _scored(capture, numbers, unrefined):
    image, spread = estimated(capture, numbers, unrefined)
    return (*losses(capture, image), spread)


def score(captures, numbers, unrefined=False):
    """(C, 3) for each capture: the losses and the spread. unrefined: without the network."""
    with ProcessPoolExecutor(mp_context=get_context("fork")) as pool:
        return np.array(list(pool.map(partial(_scored, numbers=numbers, unrefined=unrefined), captures)))


def _errors(losses):
    """Errors of sRGB colours that cost so many dB."""
    return np.sqrt((10 ** (losses / 10) - 1.0) * 10 ** (-posterior.CEILING_DB / 10))


def usual_colors(captures, trained, say=print):
    """Usual colours of objects and of open places under their true lights, a dict of numbers.

    Generated scenes share a few palettes, and trained ones are few: each of the two is half of a mean, and their
    difference is part of a spread. The albedo of a median place; the hue of the mean albedo, weighted by the light.
    """
    found = {(kind, half): defaultdict(list) for kind in ("", "_outdoors") for half in (False, True)}
    for half, each in ((False, captures), (True, trained)):
        for capture in each:
            light = harmonics.evaluate(capture["directions"], 8) @ capture["light"]
            received = np.maximum(capture["sky"] @ light.astype(np.float32) + capture["bounced"], DIMMEST)
            level = np.median(np.log(luminance(capture["captured"]) / luminance(received)))
            hue = natural.AXES[1:] @ np.log(capture["captured"].mean(axis=0) / received.mean(axis=0))
            found["_outdoors" * ("sky_seen" in capture), half][capture["scene"]].append([level, *hue])
    usual = {}
    for kind in ("", "_outdoors"):
        halves = [np.array([np.mean(each, axis=0) for each in found[kind, half].values()]) for half in (False, True)]
        halves = [each for each in halves if len(each)]
        means = np.array([half.mean(axis=0) for half in halves])
        mean = means.mean(axis=0)
        spread = np.sqrt(np.mean([((half - mean) ** 2).mean(axis=0) for half in halves], axis=0))
        usual |= {f"albedo{kind}": np.exp(mean[0])}
        usual |= {f"warmth{kind}": mean[1], f"warmth{kind}_spread": spread[1]}
        usual |= {f"green{kind}": mean[2], f"green{kind}_spread": spread[2]}
        say(f"log albedo{kind}, warmth, green: halves {means.round(2).tolist()}, spread {spread.round(2).tolist()}")
    say({name: round(float(value), 3) for name, value in usual.items()})
    return {name: float(value) for name, value in usual.items()}


def search(captures, numbers, rounds, say):
    """The numbers that lose least."""

    def loss(tried):
        rows = score(captures, tried)
        return float(rows[:, 0].mean() + PLAIN * rows[:, 1].mean())

    best = loss(numbers) if rounds else 0.0
    for turn in range(rounds):
        for name, factor in STEPS.items():
            for step in (factor, 1.0 / factor):
                tried = numbers._replace(**{name: getattr(numbers, name) * step ** (0.5**turn)})
                found = loss(tried)
                if found < best - LEAST_GAIN:
                    numbers, best = tried, found
                    say(f"{name} {getattr(numbers, name):.4g}: {best:.3f}")
                    break
    return numbers


def fit(folder, rounds=2, say=print):
    """Fit on the part "fit" of a corpus; score all parts, and write fitted.json."""
    parts = {part: load(folder, part) for part in ("fit", "choose", "test")}
    usual = usual_colors(parts["fit"], trained.load(folder), say)
    numbers = search(parts["fit"], fitted.FITTED._replace(**usual), rounds, say)
    rows = {part: score(captures, numbers) for part, captures in parts.items() if captures}
    alone = score(parts["fit"], numbers, unrefined=True)  # the network knows the kinds of the fit part
    numbers = numbers._replace(doubt=float(np.quantile(_errors(alone[:, 0]) / alone[:, 2], SURE)))
    held = {}
    for part, each in rows.items():
        held[part] = {"captures": len(each), "loss_db": round(float(each[:, 0].mean()), 2)}
        held[part] |= {"loss_plain_db": round(float(each[:, 1].mean()), 2)}
        within = _errors(each[:, 0]) <= numbers.doubt * each[:, 2]
        held[part] |= {"within_doubt": round(float(within.mean()), 2)}
        say(f"{part}: {held[part]}")
    values = {name: float(f"{value:.4g}") for name, value in numbers._asdict().items()}
    text = json.dumps({"script": "scripts/fit light", "parts": held, "values": values}, indent=1)
    fitted.FILE.write_text(text + "\n", encoding="utf-8")
    return numbers


def ablation(captures, numbers):
    """dB lost without each cue, a dict."""
    without = {
        "nothing": {},
        "parallel pairs": {"parallel": 1e-6},
        "slanted pairs": {"slanted": 1e-6},
        "distant pairs": {"distant": 1e-6},
        "the sky": {"sky": 1e-6, "clipped": 1e-6},
        "hue of the albedo": {
            f"{axis}{kind}_spread": 1e3 for axis in ("warmth", "green") for kind in ("", "_outdoors")
        },
    }
    return {name: score(captures, numbers._replace(**change)).mean(axis=0)[:2] for name, change in without.items()}
