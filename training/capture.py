"""Splats of a generated place, trained on photographs of it as captures are: sharper than those `scenes` lays out.

They start as `scenes.capture` places them; positions, shapes, opacities and colours (degree 0) then follow the
photographs, as in 3D Gaussian splatting (Kerbl et al., 2023) without its densification.
"""

import time

import numpy as np
import torch

from scenes.cameras import capture_views
from scenes.capture import FLOATER, capture
from scenes.photograph import photograph
from scenes.places import build_place
from scenes.radiosity import light
from scenes.sky import capture_sky
from splat2mesh.render.footprints import DILATION
from splat2mesh.scene.color import srgb_from_linear
from splat2mesh.splats.splats import SH_C0, Splats

from .blending import PARTS, draw, gradients

RATES = {"means": 0.02, "log_scales": 0.01, "quats": 0.003, "logits": 0.05, "dc": 0.01}
"""Largest steps of Adam; of means in units of each splat's own size."""

LEAST_OPACITY = 0.02
"""Fainter splats are left out at the end."""

STRUCTURE, WINDOW = 0.2, 11
"""Weight of structural similarity in the loss, beside that of absolute differences, and its window in pixels."""

HELD_OUT = 8
"""One view of so many is not trained on."""

SMALL_UNTIL, LAST_PACE = 0.4, 0.1
"""Share of the training in which pictures have half their size, and the pace at its end over that at first."""

SAMPLES, REPORTED = 2, 100
"""Samples along a side of a photograph's pixel; steps from one line of progress to the next."""


def train_capture(options):
    """Train a capture and save it to `out`, in the format of its name; returns lines to print.

    options: kind, seed, env, splats, vertices (of the place), views, pixels (their sides), minutes and steps (the most
    of both), out, say (takes lines of progress).
    """
    say, rng = options.say, np.random.default_rng(options.seed)
    place = build_place(options.kind, options.seed, options.vertices)
    views = capture_views(place, options.views, options.pixels)
    lighting = light(place, capture_sky(options.env))
    made = capture(place, lighting, views, options.splats, options.seed)
    student = Student(made.splats.take(np.flatnonzero(made.region != FLOATER)))
    say(f"{len(student.steps)} splats, {len(views)} views of {options.pixels} pixels")
    photographs = [
        np.uint8(255 * display(made.exposure * photograph(lighting, view, SAMPLES)[0]) + 0.5) for view in views
    ]
    held, shown = np.arange(len(views))[HELD_OUT // 2 :: HELD_OUT], []
    before, start, seconds = quality(student.splats(), views, photographs, held), time.monotonic(), 60 * options.minutes
    for step in range(options.steps):
        done = max(step / options.steps, (time.monotonic() - start) / seconds)
        if done >= 1.0:
            break
        shown = shown or rng.permutation(np.setdiff1d(np.arange(len(views)), held)).tolist()
        number = shown.pop()
        view, photo = views[number], photographs[number].astype(np.float32) / 255.0
        if done < SMALL_UNTIL:
            view, photo = view.resized(view.width // 2), halved(photo)
        loss = student.step(view, photo, LAST_PACE**done)
        if step % REPORTED == 0:
            say(f"step {step}, {time.monotonic() - start:.0f} s: loss {loss:.4f}")
            student.splats().save(options.out, overwrite=True)
    trained = student.splats()
    after = quality(trained, views, photographs, held)
    trained = trained.take(np.flatnonzero(trained.opacities > LEAST_OPACITY))
    trained.save(options.out, overwrite=True)
    gain = f"{before:.2f} to {after:.2f} dB in views that were not trained on"
    return [f"{options.out}: {len(trained)} splats, {options.out.stat().st_size / 1e6:.1f} MB; {gain}"]


def display(linear):
    """Linear radiance as a photograph shows it, in [0, 1]."""
    return srgb_from_linear(np.clip(linear, 0.0, 1.0))


def halved(picture):
    """A square picture (S, S, 3) of half the size, S even."""
    side = len(picture) // 2
    return picture.reshape(side, 2, side, 2, 3).mean(axis=(1, 3))


def quality(splats, views, photographs, chosen):
    """Mean PSNR in dB of splats from the chosen views, against photographs (H, W, 3) uint8."""
    pairs = [(np.clip(draw(splats, views[number]).picture, 0, 1), photographs[number] / 255.0) for number in chosen]
    return float(np.mean([-10 * np.log10(np.mean((shown - true) ** 2)) for shown, true in pairs]))


class Student:
    """Splats that learn: tensors of their parameters, and the moments of Adam for each row."""

    def __init__(self, splats):
        logit = np.log(np.clip(splats.opacities, 1e-3, 0.995) / (1 - np.clip(splats.opacities, 1e-3, 0.995)))
        values = {
            "means": splats.means,
            "log_scales": np.log(splats.scales),
            "quats": splats.quats_wxyz,
            "logits": logit,
            "dc": splats.sh[:, 0],
        }
        self.values = {name: torch.tensor(np.ascontiguousarray(value)) for name, value in values.items()}
        self.first = {name: torch.zeros_like(value) for name, value in self.values.items()}
        self.second = {name: torch.zeros_like(value) for name, value in self.values.items()}
        self.steps = torch.zeros(len(splats))

    def splats(self):
        """The splats as they are now."""
        v = {name: value.numpy() for name, value in self.values.items()}
        opacities = 1 / (1 + np.exp(-v["logits"]))
        return Splats(v["means"], np.exp(v["log_scales"]), v["quats"], opacities, v["dc"][:, None])

    def step(self, view, photo, pace):
        """Follow one photograph (H, W, 3): the loss before."""
        drawn = draw(self.splats(), view)
        picture = torch.tensor(drawn.picture, requires_grad=True)
        loss = difference(picture, torch.tensor(photo))
        loss.backward()
        rows, by_parts = gradients(drawn, picture.grad.numpy())
        rows = torch.tensor(rows)
        chosen = {name: value[rows].requires_grad_() for name, value in self.values.items()}
        parts = footprints(chosen, drawn.camera)
        torch.autograd.backward(list(parts), list(torch.tensor(by_parts).T))
        self.steps[rows] += 1
        count = self.steps[rows]
        for name, rate in RATES.items():
            self._follow(name, rows, chosen[name].grad, rate * pace, count)
        return float(loss.detach())

    def _follow(self, name, rows, slope, rate, count):
        """Adam, of the rows that this view shows."""
        shape = (-1,) + (1,) * (slope.dim() - 1)
        count = count.reshape(shape)
        first = 0.9 * self.first[name][rows] + 0.1 * slope
        second = 0.999 * self.second[name][rows] + 0.001 * slope**2
        self.first[name][rows], self.second[name][rows] = first, second
        move = rate * (first / (1 - 0.9**count)) / ((second / (1 - 0.999**count)).sqrt() + 1e-15)
        if name == "means":
            move = move * self.values["log_scales"][rows].max(dim=1, keepdim=True).values.exp()
        self.values[name][rows] -= move


def difference(picture, photo):
    """The loss: absolute differences and structural similarity (Wang et al., 2004), over a box of WINDOW pixels."""
    plain = (picture - photo).abs().mean()

    def mean(image):
        return torch.nn.functional.avg_pool2d(image.permute(2, 0, 1)[None], WINDOW, 1)

    a, b = mean(picture), mean(photo)
    aa, bb, ab = mean(picture**2) - a**2, mean(photo**2) - b**2, mean(picture * photo) - a * b
    alike = ((2 * a * b + 1e-4) * (2 * ab + 9e-4)) / ((a**2 + b**2 + 1e-4) * (aa + bb + 9e-4))
    return (1 - STRUCTURE) * plain + STRUCTURE * (1 - alike.mean())


def footprints(values, camera):
    """PARTS of the footprints of some splats, each (M,), as `splat2mesh.render.footprints` projects them."""
    rotation, shift = torch.tensor(camera.rotation, dtype=torch.float32), torch.tensor(camera.translation).float()
    guard = camera.guard
    local = values["means"] @ rotation.T + shift
    x, y, z = local.unbind(1)
    u, v = (x / z).clamp(guard[0], guard[1]), (y / z).clamp(guard[2], guard[3])
    axes = rotation @ turned(values["quats"]) * (values["log_scales"].exp() / z[:, None])[:, None, :]
    across = camera.fx * (axes[:, 0] - u[:, None] * axes[:, 2])
    down = camera.fy * (axes[:, 1] - v[:, None] * axes[:, 2])
    xx, xy, yy = (across**2).sum(1) + DILATION, (across * down).sum(1), (down**2).sum(1) + DILATION
    areas = sum((across[:, i] * down[:, j] - across[:, j] * down[:, i]) ** 2 for i, j in ((0, 1), (0, 2), (1, 2)))
    precision_x = yy / (areas + DILATION * (xx + yy - DILATION))
    color = (0.5 + SH_C0 * values["dc"]).clamp(min=0.0)
    place = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    parts = *place, xy / yy, precision_x, 1 / yy, values["logits"].sigmoid(), *color.unbind(1)
    assert len(parts) == len(PARTS)
    return parts


def turned(quats):
    """Rotations (M, 3, 3) of quaternions wxyz, of any length."""
    w, x, y, z = (quats / quats.norm(dim=1, keepdim=True)).unbind(1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=1).reshape(-1, 3, 3)
