"""The network that refines the captured light: its layers, what it is trained on, and its ONNX file.

Places and cells of the sphere hold WIDTH numbers each. In a round, a cell hears of the places that see it, a place of
the cells it sees and of all other places; both also hear of them in the proportions in which the present light lights
each place. After each round the logarithm of the light is changed.
"""

import numpy as np
import onnx
import torch
from torch import nn
from torch.nn import functional

WIDTH, HIDDEN, ROUNDS, HEADS = 16, 48, 3, 2

OF_PLACE, OF_CELL = 8, 7
"""Numbers that a place and a cell are given in each round."""

LEAST = 1e-4
"""Light whose logarithm is taken at least."""

OPSET = 17


class Refiner(nn.Module):
    """Log light (B, K) after each round, of a dict of tensors: `refined.NetworkInputs`, with a batch in front of what
    belongs to a capture."""

    def __init__(self):
        super().__init__()
        width, rounds = WIDTH, range(ROUNDS)

        def linear(inputs, outputs):
            return nn.ModuleList(nn.Linear(inputs, outputs) for _ in rounds)

        def layers(inputs):
            return nn.ModuleList(
                nn.Sequential(nn.Linear(inputs, HIDDEN), nn.GELU(), nn.Linear(HIDDEN, width)) for _ in rounds
            )

        self.place_in, self.cell_in = nn.Linear(OF_PLACE, width), nn.Linear(OF_CELL, width)
        self.place, self.cell = layers(6 * width + OF_PLACE), layers(6 * width + OF_CELL)
        self.query, self.key, self.value, self.message = (linear(width + OF_PLACE, width) for _ in range(4))
        self.change = linear(width + OF_CELL, 1)
        self.place_norm = nn.ModuleList(nn.LayerNorm(width) for _ in rounds)
        self.cell_norm = nn.ModuleList(nn.LayerNorm(width) for _ in rounds)
        for layer in self.change:
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)

    def forward(self, given):
        sky, captured, bounced, light = given["sky"], given["captured"], given["bounced"], given["light"]
        pool, basis, spread, height = (given[name] for name in ("pool", "basis", "spread", "height"))
        mean_of_cell = pool / pool.sum(0).clamp(1.0)
        seen = mean_of_cell.T @ given["seen"]
        visible, of_cells = sky.sum(2), sky @ pool
        by_place = of_cells / visible[..., None].clamp(1e-3)
        by_cell = (of_cells / of_cells.sum(1, keepdim=True).clamp(1e-3)).transpose(1, 2)
        log_captured = captured.clamp(LEAST).log()
        places = cells = None
        found = []
        for turn in range(ROUNDS):
            received = (sky @ light.exp()[..., None])[..., 0] + bounced
            log_received = received.clamp(LEAST).log()
            part = (sky @ (light.exp()[..., None] * pool)) / received.clamp(LEAST)[..., None]
            albedo = _centered(log_captured - log_received)
            near = (albedo.abs() < 0.3).float()
            facts = [_centered(log_received), _centered(log_captured), albedo, given["upward"], visible]
            facts += [part.sum(2), albedo**2, near]
            of_place = torch.stack(facts, 2).clamp(-4.0, 4.0)
            coarse = light @ mean_of_cell
            level = coarse - coarse.exp().mean(1, keepdim=True).log()
            up = height.expand_as(level)
            over = (seen[..., 2] - coarse).clamp(-3.0, 3.0) * seen[..., 0]
            facts = [level, up, up.clamp(0.0), seen[..., 0], seen[..., 1], seen[..., 2], over]
            of_cell = torch.stack(facts, 2).clamp(-5.0, 5.0)
            if turn == 0:
                places, cells = self.place_in(of_place), self.cell_in(of_cell)
            both = torch.cat([places, of_place], 2)
            heard = self._attention(turn, both)
            middle, most = places.mean(1, keepdim=True), places.max(1, keepdim=True).values
            told = [places, of_place, heard, by_place @ cells, part @ cells]
            told += [middle.expand_as(places), most.expand_as(places)]
            places = self.place_norm[turn](places + self.place[turn](torch.cat(told, 2)))
            message = self.message[turn](torch.cat([places, of_place], 2))
            mean = message.mean(1, keepdim=True)
            lit = (part / part.sum(1, keepdim=True).clamp(LEAST)).transpose(1, 2)
            told = [cells, of_cell, by_cell @ (message - mean), lit @ (message - mean), basis @ (basis.T @ cells)]
            told += [mean.expand_as(cells), cells.mean(1, keepdim=True).expand_as(cells)]
            cells = self.cell_norm[turn](cells + self.cell[turn](torch.cat(told, 2)))
            change = self.change[turn](torch.cat([cells, of_cell], 2))
            change = 0.7 * (basis @ (basis.T @ change)) + 0.3 * change
            light = light + change[..., 0].clamp(-2.0, 2.0) @ spread
            found.append(light)
        return found

    def _attention(self, turn, both):
        query, key, value = (
            layer[turn](both).unflatten(2, (HEADS, -1)).transpose(1, 2) for layer in (self.query, self.key, self.value)
        )
        weights = functional.softmax(query @ key.transpose(2, 3) / (WIDTH / HEADS) ** 0.5, 3)
        return (weights @ value).transpose(1, 2).flatten(2)


class _Refinement(nn.Module):
    """The change of log light (K,) of one capture."""

    def __init__(self, network):
        super().__init__()
        self.network = network

    def forward(self, sky, captured, bounced, upward, light, seen, pool, height, basis, spread):
        one = {"sky": sky, "captured": captured, "bounced": bounced, "upward": upward, "light": light, "seen": seen}
        one = {name: each[None] for name, each in one.items()}
        shared = {"pool": pool, "height": height, "basis": basis, "spread": spread}
        return self.network(one | shared)[-1][0] - light


def exported(network, example, log=()):
    """The bytes of the ONNX file.

    example: a `refined.NetworkInputs` of any number of places and directions. log: lines about the training, kept as
    metadata.
    """
    from io import BytesIO

    names = example._fields
    axes = {name: {0: "places"} for name in ("sky", "captured", "bounced", "upward")}
    axes |= {name: {0: "directions"} for name in ("light", "seen", "pool", "change")}
    axes["sky"][1], axes["spread"] = "directions", {1: "directions"}
    file = BytesIO()
    torch.onnx.export(
        _Refinement(network).eval(),
        tuple(torch.from_numpy(np.asarray(each)) for each in example),
        file,
        input_names=list(names),
        output_names=["change"],
        dynamic_axes=axes,
        opset_version=OPSET,
        dynamo=False,
    )
    model = onnx.load_from_string(file.getvalue())
    model.metadata_props.add(key="log", value="\n".join(log))
    onnx.checker.check_model(model)
    return model.SerializeToString()


def lost(light, given):
    """(B,) dB that a log light (B, K) loses, one gain aside, where relit surfaces are as bright as a fifth in sRGB."""
    received = (given["sky"] @ light.exp()[..., None])[..., 0] + given["bounced"]
    off = received.clamp(LEAST).log() - given["received"].clamp(LEAST).log()
    off = off - off.median(1, keepdim=True).values
    error = (0.05 * off.clamp(-3.0, 3.0) ** 2).mean(1)
    return 10.0 * torch.log10(1.0 + error / 10.0**-2.8)


def _centered(values):
    return values - values.mean(1, keepdim=True)
