"""Trains networks of equal size on the same samples, several seeds each, and prints their errors as lines of JSON.

    python3 ablation.py FOLDER --samples 5000000 --seeds 1 2 3 --only vin k1 cnn

FOLDER holds what `sidestep dataset make` and `sidestep dataset frozen` wrote: maps, robust, paper to learn from;
artificial.data, robust.data, paper.data to be measured on. Needs PyTorch; on a GPU CuPy too, and is a thousand times faster there.
Loss, mirroring and schedule are those of the trainer in tools/train/src.
"""
import argparse
import json
import math
import pathlib
import time

import numpy as np
import torch

from networks import CELLS, SIDE, Network, check

RECORD = np.dtype([
    ("cost", "u1", CELLS), ("goal", "<u2"), ("source", "u1"), ("kind", "u1"), ("world", "<u4"), ("goal_m", "<f4", 2),
    ("velocity", "<f4", 2), ("plain", "<f4", 2), ("cost_plain", "<f4"), ("solved", "<f4", 2), ("cost_solved", "<f4"),
    ("stream", "<u8"), ("reserved", "u1", 8),
])
HEADER = 4096
DEMONSTRATIONS = ("robust", "paper")
# Limits of launch/robots/loomo.toml: m/s2 and rad/s2, m/s and rad/s.
ACCELERATION, LEAST, MOST, WINDOW_S = (1.0, 3.0), (-0.2, -1.5), (1.0, 1.5), 0.3
HUBER, DOUBT_WEIGHT, CLIP, RATE, WARM_UP = 0.05, 0.02, 0.5, 2e-3, 200

WIDE_HEAD = dict(convolutions=[(32, 1), (64, 2), (64, 2)], hidden=[256, 128])
DENSE_HEAD = dict(convolutions=[], hidden=[512, 256])
RUNS = {
    "vin": dict(network=dict(rounds=36, **DENSE_HEAD)),
    "k1": dict(network=dict(rounds=1, **DENSE_HEAD)),
    "cnn": dict(network=dict(rounds=0, **WIDE_HEAD)),
    "vin-cnn": dict(network=dict(rounds=36, **WIDE_HEAD)),
    "vin-plain-labels": dict(network=dict(rounds=36, **DENSE_HEAD), labels="plain"),
    "vin-demonstrations": dict(network=dict(rounds=36, **DENSE_HEAD), data=DEMONSTRATIONS),
    "vin-maps": dict(network=dict(rounds=36, **DENSE_HEAD), data=("maps",)),
}


class Data:
    def __init__(self, folder, names, device, most=-1):
        parts = [np.fromfile(folder / name, RECORD, offset=HEADER, count=most) for name in names]
        records = np.concatenate(parts)
        self.count = len(records)
        put = lambda array: torch.from_numpy(np.ascontiguousarray(array)).to(device)
        self.cost, self.goal = put(records["cost"]), put(records["goal"].astype("i8"))
        self.velocity, self.plain, self.solved = (put(records[name]) for name in ("velocity", "plain", "solved"))


def window(velocity, seconds):
    edge = lambda sign: torch.stack(
        [(velocity[:, i] + sign * ACCELERATION[i] * seconds).clamp(LEAST[i], MOST[i]) for i in (0, 1)], 1)
    return edge(-1), edge(1)


def within(wish, edges):
    return torch.maximum(torch.minimum(wish, edges[1]), edges[0])


def wish_of(out, velocity):
    return velocity + torch.stack([out[:, i] * (ACCELERATION[i] * WINDOW_S) for i in (0, 1)], 1)


def loss(out, velocity, label):
    edges = window(velocity, WINDOW_S)
    target, wish = within(label, edges), wish_of(out, velocity)
    idle = ((target >= edges[1]) & (wish >= edges[1])) | ((target <= edges[0]) & (wish <= edges[0]))
    size = torch.where(idle, torch.zeros_like(wish), wish - target).abs()
    command = torch.where(size < HUBER, 0.5 * size * size / HUBER, size - 0.5 * HUBER).sum(1).mean()
    return command + DOUBT_WEIGHT * (doubt_pull(out, wish, target, edges) * out[:, 2:]).sum(1).mean()


@torch.no_grad()
def doubt_pull(out, wish, target, edges):
    """Slope of the doubt's logarithm: a Laplace distribution, one surprise limited, beyond the range only the way back."""
    log = out[:, 2:].clamp(-7.0, 1.5)
    pull = (1.0 - (within(wish, edges) - target).abs() * torch.exp(-log)).clamp(min=-10.0)
    outside = ((out[:, 2:] > log) & (pull < 0.0)) | ((out[:, 2:] < log) & (pull > 0.0))
    return torch.where(outside, torch.zeros_like(pull), pull)


@torch.no_grad()
def errors(network, data, label):
    """Mean absolute error of v [m/s] and w [rad/s] within 0.1 s, and its standard deviation."""
    spans = [slice(start, start + 4096) for start in range(0, data.count, 4096)]
    out = torch.cat([network(data.cost[span], data.goal[span], data.velocity[span]) for span in spans])
    edges = window(data.velocity, 0.1)
    off = (within(wish_of(out, data.velocity), edges) - within(label, edges)).abs()
    return [round(x, 4) for x in (*off.mean(0).tolist(), *off.std(0).tolist())]


class Batch:
    """The place that samples are drawn into, half of them mirrored."""

    def __init__(self, data, labels, size, seed):
        device = data.cost.device
        self.data, self.labels = data, getattr(data, labels)
        self.random = torch.Generator(device=device)
        self.random.manual_seed(seed)
        self.index = torch.zeros(size, dtype=torch.long, device=device)
        self.mirror = torch.zeros(size, dtype=torch.bool, device=device)

    def draw(self):
        self.index.random_(0, self.data.count, generator=self.random)
        self.mirror.copy_(torch.rand(len(self.mirror), device=self.index.device, generator=self.random) < 0.5)

    def samples(self):
        cost, goal = self.data.cost[self.index].view(-1, SIDE, SIDE), self.data.goal[self.index]
        cost = torch.where(self.mirror[:, None, None], cost.flip(2), cost).reshape(-1, CELLS)
        goal = torch.where(self.mirror, goal // SIDE * SIDE + SIDE - 1 - goal % SIDE, goal)
        sign = torch.where(self.mirror, -1.0, 1.0)
        turned = lambda pairs: torch.stack([pairs[:, 0], pairs[:, 1] * sign], 1)
        return cost, goal, turned(self.data.velocity[self.index]), turned(self.labels[self.index])


def step_of(network, batch, optimiser):
    def step():
        cost, goal, velocity, label = batch.samples()
        value = loss(network(cost, goal, velocity), velocity, label)
        for parameter in network.parameters():
            parameter.grad = None
        value.backward()
        slopes = [parameter.grad for parameter in network.parameters()]
        norm = torch.sqrt(sum((slope**2).sum() for slope in slopes))
        scale = torch.clamp(CLIP / (norm + 1e-12), max=1.0)
        for slope in slopes:
            slope.mul_(scale)
        optimiser.step()
    return step


def captured(step, number, graph):
    """Runs a step; on a GPU as a graph from the fourth on, which saves the launches."""
    if not torch.cuda.is_available():
        step()
    elif graph is None and number < 3:
        side = torch.cuda.Stream()
        side.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(side):
            step()
        torch.cuda.current_stream().wait_stream(side)
    else:
        if graph is None:
            graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(graph):
                step()
        graph.replay()
    return graph


def train(run, data, samples, size, seed, device):
    torch.manual_seed(seed)
    network = Network(**run["network"]).to(device)
    batch = Batch(data, run.get("labels", "solved"), size, seed)
    on_gpu = device == "cuda"
    rate = torch.tensor(RATE, device=device)
    optimiser = torch.optim.Adam(network.parameters(), lr=rate, capturable=on_gpu, fused=on_gpu)
    step, graph = step_of(network, batch, optimiser), None
    for number in range(samples // size):
        cosine = 0.505 + 0.495 * math.cos(math.pi * number * size / samples)
        rate.fill_(RATE * cosine * min(1.0, (number + 1) / WARM_UP))
        batch.draw()
        graph = captured(step, number, graph)
    return network


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--samples", type=int, default=5_000_000)
    parser.add_argument("--batch", type=int, default=1024)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--only", nargs="+", choices=list(RUNS), default=list(RUNS))
    chosen = parser.parse_args()
    device = "cuda" if torch.cuda.is_available() else "cpu"
    if device == "cuda":
        print(json.dumps({"device": torch.cuda.get_device_name(), "fused_against_autograd": check(device)}))
    kept = {}
    tests = {name: Data(chosen.folder, [f"{name}.data"], device, 10_000) for name in ("artificial", *DEMONSTRATIONS)}
    for seed in chosen.seeds:
        for name in chosen.only:
            run = RUNS[name]
            files = run.get("data", ("maps", *DEMONSTRATIONS))
            if files not in kept:
                kept[files] = Data(chosen.folder, files, device)
            began = time.time()
            network = train(run, kept[files], chosen.samples, chosen.batch, seed, device)
            found = {test: errors(network, data, data.solved) for test, data in tests.items()}
            parameters = sum(parameter.numel() for parameter in network.parameters())
            print(json.dumps({"run": name, "seed": seed, "parameters": parameters, "errors": found,
                              "seconds": round(time.time() - began, 1)}), flush=True)


if __name__ == "__main__":
    main()
