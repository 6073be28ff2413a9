"""Pictures of a scene under lights, and how near a relit splat comes to them.

A folder of `python -m scenes OUT --relit LIGHT` holds cameras.json and truth_LIGHT.npz. Any other holds test_views.npz:
w2c (S, 4, 4), K (3, 3) or (S, 3, 3), alpha (S, H, W) from 0 to 255 and lin_LIGHT (S, H, W, 3). There `lamps:CASE` is a
case of lamps.npz, which replaces what it holds, with alpha_CASE.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from splat2mesh.base.errors import InputError
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.color import linear_from_srgb, srgb_from_linear
from splat2mesh.views.cameras import usable_views

GAINS = 0.2, 5.0
"""Least and largest gain that is tried."""

SURE = 1e-3
"""Of a logarithm of a gain: far less than what an eye sees."""


class Psnr(NamedTuple):
    """In dB, means over the views: as shown, with the best gain, with the best gain of each colour. gain: that one."""

    psnr: float
    psnr_gain: float
    psnr_wb: float
    gain: float


class Pictures:
    """Path-traced or ray-cast pictures of a scene. Raises InputError for a folder without any."""

    def __init__(self, folder):
        self._folder = Path(folder)
        self._trained = (self._folder / "test_views.npz").exists()
        if not (self._trained or (self._folder / "truth.json").exists()):
            raise InputError(f"{folder}: expected test_views.npz, or truth.json of `python -m scenes`; found neither")

    def under(self, light):
        """The views, masks (H, W) of where the scene is, and linear pictures (H, W, 3), a list of each."""
        return self._of_test_views(light) if self._trained else self._of_generated(light)

    def pixels(self, splats, light):
        """Linear colours that splats show and sRGB that is wanted, (P, 3) of every view, where the scene is."""
        shown, wanted = [], []
        for view, inside, picture in zip(*self.under(light), strict=True):
            shown.append(linear_from_srgb(np.clip(rasterize(splats, view).color[inside], 0, 1)))
            wanted.append(srgb_from_linear(np.clip(picture[inside].astype(np.float32), 0, 1)))
        return shown, wanted

    def score(self, splats, light):
        """The Psnr of splats under a light. Raises InputError for a light without pictures."""
        return psnr(*self.pixels(splats, light))

    def _of_test_views(self, light):
        with np.load(self._folder / "test_views.npz") as data:
            known = dict(data)
        kind, case, name = light.rpartition(":")[0], ":" in light, light.rpartition(":")[2]
        if case:
            if not (self._folder / f"{kind}.npz").exists():
                raise InputError(f"{light}: {self._folder} holds no {kind}.npz")
            with np.load(self._folder / f"{kind}.npz") as data:
                known |= dict(data)
        if f"lin_{name}" not in known:
            found = " ".join(sorted(key.removeprefix("lin_") for key in known if key.startswith("lin_")))
            raise InputError(f"{light}: expected a light of {self._folder}: {found}")
        alpha = known[f"alpha_{name}" if case else "alpha"] / 255
        height, width = alpha.shape[1:]
        matrices = np.broadcast_to(known["K"], (len(alpha), 3, 3))
        views = [
            View(width, height, k[0, 0], k[1, 1], k[0, 2], k[1, 2], pose.astype(np.float64))
            for k, pose in zip(matrices, known["w2c"], strict=True)
        ]
        return views, list(alpha > 0.5), list(known[f"lin_{name}"])

    def _of_generated(self, light):
        file = self._folder / f"truth_{light}.npz"
        if not file.exists():
            found = sorted(path.stem.removeprefix("truth_") for path in self._folder.glob("truth_*.npz"))
            raise InputError(f"{light}: expected a light of {self._folder}: {' '.join(found)}")
        with np.load(file) as data:
            if "pictures" not in data:
                raise InputError(f"{file}: it holds no pictures; only places have them")
            pictures, solid, numbers = data["pictures"], data["solid"], data["view"]
        views = usable_views(self._folder / "cameras.json")
        return [views[number].resized(max(pictures.shape[1:3])) for number in numbers], list(solid), list(pictures)


def psnr(shown, wanted):
    """The Psnr of linear colours against those that are wanted, sRGB, lists of (P, 3).

    The exposure of a capture is unknown, so a gain is free: each is the one that brings the most decibels.
    """

    def errors(gain, channel):
        """(views,) mean squared errors of a channel in sRGB."""
        pairs = zip(shown, wanted, strict=True)
        return np.array(
            [np.square(srgb_from_linear(np.clip(gain * s[:, channel], 0, 1)) - w[:, channel]).mean() for s, w in pairs]
        )

    def decibels(each):
        return float(-10 * np.log10(np.maximum(np.mean(each, axis=0), 1e-12)).mean())

    def best(score):
        logs = np.log(GAINS)
        found = minimize_scalar(lambda x: -score(np.exp(x)), bounds=logs, method="bounded", options={"xatol": SURE})
        return float(np.exp(found.x))

    def alike(gain):
        return [errors(gain, channel) for channel in range(3)]

    gain = best(lambda value: decibels(alike(value)))
    gained = decibels(alike(gain))
    each = alike(gain)
    for _ in range(2):  # the gain of one colour depends a little on the others: the mean is one of logarithms
        for channel in range(3):
            others = [each[c] for c in range(3) if c != channel]
            found = best(lambda value, c=channel, o=others: decibels([errors(value, c), *o]))
            each[channel] = errors(found, channel)
    return Psnr(decibels(alike(1.0)), gained, decibels(each), gain)
