"""Fit the numbers of the captured light: weights of cues and scales of their noise, on one part of the corpus.

A coordinate search over the logarithms of the numbers minimises the loss of relit colours against the known light, with
one gain for each colour, and a fifth of the loss without any gain. The choose and the test part are only scored.
"""

import json
from collections import defaultdict

import numpy as np

from relight.albedo import fitted, natural, posterior
from relight.albedo.evidence import Evidence, LitPlaces, SeenSky
from relight.sh import harmonics
from splat2mesh.scene.color import luminance, srgb_from_linear

from .captures import DIRECTIONS, harmonics_of, load

STEPS = {
    "contrast": 3.0,
    "parallel": 2.0,
    "slanted": 2.0,
    "difference": 1.4,
    "sky": 3.0,
    "sky_noise": 1.5,
    "clipped": 3.0,
    "clipped_level": 1.4,
    "clipped_noise": 1.5,
    "parallel_slope": 4.0,
    "slanted_slope": 4.0,
    "albedo_spread": 1.5,
    "color_spread": 2.0,
}
"""First factor on each number that is tried."""

PLAIN = 0.2
"""Weight of the loss without a gain."""

CEILING_DB = 28.0
"""PSNR of a relit splat whose light is known: errors of the light add to its error."""

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


def estimated(capture, numbers):
    """The image (64, 128, 3) of the estimated light, and the spread of its posterior."""
    evidence = evidence_of(capture, numbers)
    lights = posterior.lights_of(evidence, natural.natural_light())
    image = posterior.mean_radiance(lights, DIRECTIONS).reshape(64, 128, 3)
    return image, posterior.spread(evidence, lights)


def losses(capture, image):
    """(with a gain for each colour, without) dB lost against the known light, means over its new lights."""
    true = np.maximum(capture["seen_transfer"] @ capture["light"], 0.0) + capture["seen_bounced"]
    found = np.maximum(capture["seen_transfer"] @ harmonics_of(image), 0.0) + capture["seen_bounced"]
    good = true.min(axis=1) > 1e-3
    off = np.log(true[good]) - np.log(np.maximum(found[good], 1e-4))
    floor, lost = 10 ** (-CEILING_DB / 10), []
    for each in (off - np.median(off, axis=0), off):
        found = []
        for wanted in capture["relit"]:
            shown = np.clip(wanted[good] * np.exp(np.clip(each, -5.0, 5.0)), 0.0, 1.0)
            error = srgb_from_linear(shown.astype(np.float32)) - srgb_from_linear(np.clip(wanted[good], 0.0, 1.0))
            found.append(10 * np.log10(1.0 + np.square(error).mean() / floor))
        lost.append(float(np.mean(found)))
    return tuple(lost)


def score(captures, numbers):
    """(C, 3) for each capture: the losses and the spread."""
    rows = []
    for capture in captures:
        image, spread = estimated(capture, numbers)
        rows.append((*losses(capture, image), spread))
    return np.array(rows)


def usual_colors(captures, say=print):
    """Usual colours of scenes under their true lights, a dict of numbers. An object may be of anything: its hue is
    as unsure as that of all scenes. Soil and plants are alike."""
    found = {False: defaultdict(list), True: defaultdict(list)}
    for capture in captures:
        light = harmonics.evaluate(capture["directions"], 8) @ capture["light"]
        received = np.maximum(capture["sky"] @ light.astype(np.float32) + capture["bounced"], DIMMEST)
        level = np.median(np.log(luminance(capture["captured"]) / luminance(received)))
        hue = natural.AXES[1:] @ np.log(capture["captured"] / received).mean(axis=0)
        found["sky_seen" in capture][capture["scene"]].append([level, *hue])
    objects, outdoors = (np.array([np.mean(each, axis=0) for each in found[kind].values()]) for kind in (False, True))
    every = np.vstack([objects, outdoors])
    usual = {"albedo": np.exp(objects[:, 0].mean()), "albedo_outdoors": np.exp(outdoors[:, 0].mean())}
    for name, values in (("warmth", every[:, 1]), ("warmth_outdoors", outdoors[:, 1]), ("green", every[:, 2])):
        usual |= {name: values.mean(), f"{name}_spread": values.std()}
    say({name: round(float(value), 3) for name, value in usual.items()})
    say(f"log albedo varies over scenes by {objects[:, 0].std():.2f}, outdoors by {outdoors[:, 0].std():.2f}")
    return {name: float(value) for name, value in usual.items()}


def search(captures, numbers, rounds, say):
    """The numbers that lose least."""

    def loss(tried):
        rows = score(captures, tried)
        return float(rows[:, 0].mean() + PLAIN * rows[:, 1].mean())

    best = loss(numbers)
    say(f"start {best:.3f}")
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
    """Fit on the part "fit" of a corpus, score all parts, and write fitted.json."""
    parts = {part: load(folder, part) for part in ("fit", "choose", "test")}
    numbers = fitted.FITTED
    if rounds:
        numbers = numbers._replace(**usual_colors(parts["fit"], say))
        numbers = search(parts["fit"], numbers, rounds, say)
    rows = {part: score(captures, numbers) for part, captures in parts.items() if captures}
    held = {}
    for part, each in rows.items():
        held[part] = {"captures": len(each), "loss_db": round(float(each[:, 0].mean()), 2)}
        held[part] |= {"loss_plain_db": round(float(each[:, 1].mean()), 2)}
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
        "contrast": {"contrast": 1e-6},
        "the sky": {"sky": 1e-6, "clipped": 1e-6},
        "hue": {"warmth_spread": 1e3, "green_spread": 1e3},
        "a sun": {"sun": 1e6},
    }
    return {name: score(captures, numbers._replace(**change)).mean(axis=0)[:2] for name, change in without.items()}
