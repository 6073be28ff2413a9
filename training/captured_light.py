"""Training of the network that refines the captured light, on generated scenes under photographed lights.

A scene is captured under several lights and under mixtures of them; the posterior of each capture is where the network
begins, and the known light is what it should end with. Paints are drawn anew for each step: by colour, by the way a
surface faces, by patches. So the network cannot learn which colour a wall or a lawn has. Parts of the sky are hidden
from some of the places, as faulty meshes hide them; the known light is then seen through the same mesh.
"""

import copy
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from fitting import captures, light, lit_scenes
from relight.albedo import fitted, natural, posterior, refined
from relight.albedo.captured import DARK, SATURATED
from relight.albedo.evidence import Evidence
from relight.albedo.refined import NetworkInputs, inputs_of
from relight.albedo.samples import SAMPLES
from relight.sh import harmonics
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.color import luminance

from .light_network import LEAST, Refiner, exported, lost

MIXTURES = 4
"""Captures of a scene under two or three of its lights at once."""

BATCH, SEEN_PLACES = 8, 320
"""Captures of a step, and places of each."""

RATE, DECAY, WARM_UP = 1.5e-3, 5e-2, 100
"""Largest learning rate, after so many steps, and weight decay."""

OF_ROUNDS = 0.15, 0.25, 0.6
"""Weights of the loss after each round."""

NOISE, CONTRAST, PAINT, START = 0.15, 0.25, 0.5, 0.3
"""Spreads: of noise in log colour at most, of the factor on contrasts of log albedo, of the log albedo of what faces
one way or is bright, and of the harmonics of the light that the network begins with."""

OFTEN, SKYLESS = 0.75, 0.4
"""Shares of captures: in other paints, and without their sky."""

JUDGE_EVERY = 60.0
"""Seconds between scores on the choose part; the best average is kept."""

HIDDEN, VEIL, SINGLE, STRAY = 0.7, 3.0, 0.3, 0.1
"""Share of captures with a faulty mesh; the largest logit of the harmonics that veil the sky of some of its places; the
largest shares of cells that are hidden from one place, and of places that show the colour of another."""

AVERAGED = 0.01
"""What a step adds to the average of the weights, which is kept."""


def train(options):
    """Train as `scripts/train captured-light` says and write the ONNX file; returns lines to print.

    options: corpus (folder of captures, made where missing), lights (folder of light maps), minutes, seed, out,
    say(line).
    """
    log = []

    def say(line):
        log.append(line)
        options.say(line)

    torch.manual_seed(options.seed)
    rng = np.random.default_rng(options.seed)
    maps = captures.light_maps(options.lights)
    scenes = []
    for path in lit_scenes.make(options.corpus, maps, say):
        scene = lit_scenes.LitScene.load(path)
        scenes.append([_begun(scene, *each, rng) for each in _captured(scene, rng)])
    judged = captures.load(options.corpus, "choose")
    say(f"{len(scenes)} scenes, {sum(map(len, scenes))} captures; {len(judged)} to choose by")
    network = _fit(scenes, [_judged(each) for each in judged], 60.0 * options.minutes, rng, say)
    file = Path(options.out) / f"{refined.MODEL}.onnx"
    file.write_bytes(exported(network, _taken(scenes[0][0].inputs, slice(None)), log))
    return [f"{file}: {file.stat().st_size:,} bytes"]


class Example(NamedTuple):
    """A capture to learn from. inputs: of all its places, `sky` as float16. light: (K,) true luminance of the light."""

    inputs: NetworkInputs
    light: np.ndarray


def _captured(scene, rng):
    """(captured, bounced, light map) of a LitScene under each of its lights, and under mixtures of them."""
    count = len(scene.images)
    for number in range(count + MIXTURES):
        shares = np.eye(count)[number % count]
        if number >= count:
            chosen = rng.choice(count, rng.integers(2, 4), replace=False)
            shares = np.zeros(count)
            shares[chosen] = rng.dirichlet(np.ones(len(chosen)))
        yield tuple(np.tensordot(shares, each, 1) for each in (scene.captured, scene.bounced, scene.images))


def _begun(scene, captured, bounced, image, rng):
    """The Example of a capture: the posterior's light as its beginning, the known light as its end."""
    rows = np.flatnonzero((captured.min(axis=1) > DARK) & (captured.max(axis=1) < SATURATED))
    rows = rows[(np.arange(SAMPLES) * len(rows)) // SAMPLES] if len(rows) > SAMPLES else rows
    places = scene.places(rows, captured, bounced)
    evidence = Evidence(places, scene.seen_sky(image, rng), fitted.FITTED)
    start = posterior.mean_radiance(posterior.lights_of(evidence, natural.natural_light()), places.directions)
    true = luminance(captures.around(image, places.directions)) / np.median(luminance(places.captured))
    inputs = inputs_of(evidence, start, np.arange(len(rows)))
    inputs = inputs._replace(sky=inputs.sky.astype(np.float16))  # 5 MB; there are hundreds
    return Example(inputs, true.astype(np.float32))


def _judged(capture):
    """A capture of the choose part: its arrays, Evidence, and the image of the posterior's light."""
    return (
        capture,
        light.evidence_of(capture, fitted.FITTED),
        light.estimated(capture, fitted.FITTED, unrefined=True)[0],
    )


def _fit(scenes, judged, seconds, rng, say):
    """The average network of a training that lasts so many seconds, with the least loss on the captures to judge by."""
    network, average, best = Refiner(), Refiner(), (np.inf, None)
    average.load_state_dict(network.state_dict())
    optimizer = torch.optim.AdamW(network.parameters(), RATE, weight_decay=DECAY)
    begun, step, judge_at = time.monotonic(), 0, JUDGE_EVERY
    while (spent := time.monotonic() - begun) < seconds:
        fading = 0.5 + 0.5 * np.cos(np.pi * spent / seconds)
        optimizer.param_groups[0]["lr"] = RATE * fading * min(1.0, (step + 1) / WARM_UP)
        given = _batch(
            [scenes[row][rng.integers(len(scenes[row]))] for row in rng.integers(len(scenes), size=BATCH)], rng
        )
        losses = [lost(each, given).mean() for each in network(given)]
        optimizer.zero_grad()
        sum(weight * each for weight, each in zip(OF_ROUNDS, losses, strict=True)).backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        step += 1
        for kept, new in zip(average.parameters(), network.parameters(), strict=True):
            kept.data.lerp_(new.data, AVERAGED if step > WARM_UP else 1.0)
        if judged and spent > judge_at:
            judge_at += JUDGE_EVERY
            loss = np.mean([_loss(average, *each) for each in judged])
            say(f"{spent:4.0f} s, {step} steps: {float(losses[-1].detach()):.2f} dB lost, choose part {loss:.2f}")
            if loss < best[0]:
                best = loss, copy.deepcopy(average.state_dict())
    average.load_state_dict(best[1] or average.state_dict())
    return average


def _loss(network, capture, evidence, image):
    """dB that a capture loses with its light refined, one gain a colour."""
    directions = evidence.places.directions

    def change(inputs):
        with torch.no_grad():
            given = _tensors([inputs])
            return (network(given)[-1] - given["light"])[0].numpy()

    found = posterior.Refinement(directions, refined.change_of(evidence, captures.around(image, directions), change))
    return light.losses(capture, image * np.exp(found.at(captures.DIRECTIONS)).reshape(64, 128, 1))[0]


def _batch(examples, rng):
    """Tensors of captures with SEEN_PLACES each, in other paints, with other noise, some without their sky."""
    found, received = [], []
    for each in examples:
        count = len(each.inputs.captured)
        rows = rng.choice(count, SEEN_PLACES, replace=count < SEEN_PLACES)
        inputs = _hidden(_taken(each.inputs, rows), rng)
        received.append(np.maximum(inputs.sky @ each.light + inputs.bounced, LEAST))
        found.append(_varied(inputs, received[-1], rng))
    return _tensors(found) | {"received": torch.from_numpy(np.stack(received))}


def _hidden(inputs, rng):
    """NetworkInputs whose places see less of the sky, as behind a faulty mesh."""
    if rng.random() > HIDDEN:
        return inputs
    count, cells = len(inputs.captured), inputs.pool.shape[1]
    harmonic = harmonics.evaluate(fibonacci_sphere(len(inputs.light)), 4)
    veil = rng.uniform(0.0, VEIL) + VEIL * rng.random() * (harmonic @ rng.standard_normal(harmonic.shape[1]))
    some = rng.random((count, 1)) < rng.random()
    free = np.where(some, 1.0 / (1.0 + np.exp(-veil)), 1.0)
    free = free * ((rng.random((count, cells)) > rng.uniform(0.0, SINGLE)) @ inputs.pool.T)
    return inputs._replace(sky=inputs.sky * free.astype(np.float32))


def _taken(inputs, rows):
    """Some of the places of NetworkInputs."""
    of_places = ("sky", "captured", "bounced", "upward")
    return inputs._replace(**{name: getattr(inputs, name)[rows].astype(np.float32) for name in of_places})


def _varied(inputs, received, rng):
    """NetworkInputs in other paints; the light from other surfaces is kept but for noise."""
    count, up = len(received), inputs.upward
    log = np.log(np.maximum(inputs.captured, 1e-4)) + rng.uniform(0.0, NOISE) * rng.standard_normal(count)
    if rng.random() < OFTEN:
        albedo = log - np.log(np.maximum(received, 1e-3))
        log += np.clip(CONTRAST * rng.standard_normal() * (albedo - albedo.mean()), -1.5, 1.5)
    if rng.random() < OFTEN:
        facing = np.stack([up, np.maximum(up, 0.0) ** 4, np.abs(up)], axis=1)
        log += np.clip(facing @ (PAINT * rng.standard_normal(3)), -1.2, 1.2)
    if rng.random() < 0.5:
        order = np.argsort(log)
        log[order[: rng.integers(1, count)]] += PAINT * rng.standard_normal()
    stray = rng.random(count) < rng.uniform(0.0, STRAY)
    log[stray] = rng.permutation(log)[stray]
    bounced = inputs.bounced * np.exp(0.2 * rng.standard_normal() + 0.1 * rng.standard_normal(count))
    light = inputs.light
    if rng.random() < 0.5:
        light = light + START * harmonics.evaluate(fibonacci_sphere(len(light)), 3) @ rng.standard_normal(9)
    seen = inputs.seen * (rng.random() > SKYLESS)
    varied = (np.exp(log), bounced, light, seen)
    captured, bounced, light, seen = (each.astype(np.float32) for each in varied)
    return inputs._replace(captured=captured, bounced=bounced, light=light, seen=seen)


def _tensors(captured):
    """NetworkInputs of several captures with equally many places, as a dict of tensors."""
    own = ("sky", "captured", "bounced", "upward", "light", "seen")
    given = {name: torch.from_numpy(np.stack([getattr(each, name) for each in captured])) for name in own}
    given |= {name: torch.from_numpy(getattr(captured[0], name)) for name in ("pool", "height", "basis", "spread")}
    return given
