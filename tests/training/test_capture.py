"""Training of splats on photographs: gradients against automatic ones of a plain blending, and a small training."""

from argparse import Namespace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from splat2mesh.render.footprints import camera_of  # noqa: E402
from splat2mesh.render.rasterize import MAX_ALPHA, rasterize  # noqa: E402
from splat2mesh.render.view import View  # noqa: E402
from splat2mesh.splats.formats import read_splats  # noqa: E402
from splat2mesh.splats.splats import Splats  # noqa: E402
from training.blending import draw, gradients  # noqa: E402
from training.capture import Student, difference, footprints, train_capture  # noqa: E402

VIEW = View.look_at((0.2, 0.1, -4.0), (0.0, 0.0, 0.0), (0.0, -1.0, 0.0), 45.0, 40, 35)


@pytest.fixture
def splats():
    rng = np.random.default_rng(4)
    count = 40
    means, sizes = rng.normal(size=(count, 3)) * 0.5, np.exp(0.4 * rng.normal(size=(count, 3)) - 1.5)
    colors = 0.3 * rng.normal(size=(count, 1, 3))
    return Splats(means, sizes, rng.normal(size=(count, 4)), rng.uniform(0.1, 0.9995, count), colors)


def test_it_draws_what_the_rasteriser_draws(splats):
    np.testing.assert_allclose(draw(splats, VIEW).picture, rasterize(splats, VIEW).color, atol=2e-6)


def test_gradients_are_those_of_a_plain_blending(splats):
    """The oracle blends all splats at all pixels by torch, which differentiates it; both cut splats off alike."""
    drawn = draw(splats, VIEW)
    wanted = np.random.default_rng(1).normal(size=drawn.picture.shape).astype(np.float32)
    found, expected = (
        {name: torch.zeros_like(value) for name, value in Student(splats).values.items()} for _ in range(2)
    )
    rows, by_parts = gradients(drawn, wanted)
    chosen = {name: value[rows].requires_grad_() for name, value in Student(splats).values.items()}
    torch.autograd.backward(list(footprints(chosen, drawn.camera)), list(torch.tensor(by_parts).T))
    for name, value in chosen.items():
        found[name][rows] = value.grad

    every = {name: value.clone().requires_grad_() for name, value in Student(splats).values.items()}
    (plain(every, VIEW) * torch.tensor(wanted)).sum().backward()
    for name, value in every.items():
        expected[name] = value.grad
        scale = float(value.grad.abs().max())
        # float32 sums of some hundred pixels, and an exponential that is good to 3e-6
        np.testing.assert_allclose(found[name], expected[name], atol=2e-4 * scale, err_msg=name)


def plain(values, view):
    """The picture (H, W, 3) of all splats at all pixels, front to back."""
    camera = camera_of(view)
    x, y, slope, precision_x, precision_y, opacity, *color = footprints(values, camera)
    depth = values["means"] @ torch.tensor(camera.rotation[2], dtype=torch.float32)
    rows, columns = torch.meshgrid(torch.arange(view.height) + 0.5, torch.arange(view.width) + 0.5, indexing="ij")
    picture, light = torch.zeros(view.height, view.width, 3), torch.ones(view.height, view.width)
    for k in torch.argsort(depth):
        dy = rows - y[k]
        q = precision_y[k] * dy**2 + precision_x[k] * (columns - x[k] - slope[k] * dy) ** 2
        alpha = (opacity[k] * torch.exp(-q / 2)).clamp(max=float(MAX_ALPHA))
        alpha = torch.where(q <= 2 * torch.log(255 * opacity[k]), alpha, 0.0)
        picture = picture + (light * alpha)[..., None] * torch.stack([each[k] for each in color])
        light = light * (1 - alpha)
    return picture


def test_the_loss_of_a_picture_with_itself_is_nothing():
    picture = torch.rand(20, 24, 3, generator=torch.Generator().manual_seed(0))
    assert float(difference(picture, picture)) < 1e-6
    assert float(difference(picture, picture.flip(0))) > 0.1


def test_training_comes_closer_to_photographs_that_it_does_not_see(tmp_path):
    out = tmp_path / "nook.ply"
    options = Namespace(kind="nook", seed=0, env="noon", splats=1500, vertices=3000, views=16, pixels=64)
    options.minutes, options.steps, options.out, options.say = 5.0, 60, out, lambda line: None
    (line,) = train_capture(options)
    before, after = (float(line.split("; ")[1].split()[word]) for word in (0, 2))
    assert after > before + 1.0
    assert len(read_splats(out)) > 1000
