"""The networks that are compared, and value iteration for them: fused on a GPU, else by automatic differentiation."""
import math
import pathlib

import torch
import torch.nn as nn
import torch.nn.functional as F

SIDE, CELLS, THREADS = 28, 784, 224
# Rows and columns of the crop round the robot, and where its axle is (nodes/policy/src/network.rs).
CROP, ROBOT = (slice(10, 26), slice(4, 24)), (slice(23, 25), slice(13, 15))
CROP_SIZE = (16, 20)
COMPILED = {}


def compiled(channels):
    if channels not in COMPILED:
        import cupy
        code = pathlib.Path(__file__).with_name("value_iteration.cu").read_text()
        module = cupy.RawModule(code=f"#define CHANNELS {channels}\n{code}", options=("--std=c++14",))
        COMPILED[channels] = module.get_function("forward"), module.get_function("backward")
    return COMPILED[channels]


def launch(function, maps, *arguments):
    import cupy
    import numpy
    pointers = [numpy.int32(a) if isinstance(a, int) else a.data_ptr() for a in arguments]
    with cupy.cuda.ExternalStream(torch.cuda.current_stream().cuda_stream):
        function((maps,), (THREADS,), tuple(pointers))


class Fused(torch.autograd.Function):
    @staticmethod
    def forward(context, reward, kernels, rounds):
        reward, kernels = reward.contiguous(), kernels.contiguous()
        maps, channels = reward.shape[:2]
        values = torch.empty(maps, rounds, CELLS, device=reward.device)
        winners = torch.empty(maps, rounds, CELLS, dtype=torch.uint8, device=reward.device)
        launch(compiled(channels)[0], maps, reward, kernels, values, winners, rounds)
        context.save_for_backward(kernels, values, winners)
        return values[:, -1].reshape(maps, 1, SIDE, SIDE)

    @staticmethod
    def backward(context, slope):
        kernels, values, winners = context.saved_tensors
        (maps, rounds), channels = values.shape[:2], kernels.shape[0]
        slope = slope.contiguous()
        rewards = torch.empty(maps, channels, SIDE, SIDE, device=slope.device)
        sums = torch.empty(maps, channels * 9, device=slope.device)
        launch(compiled(channels)[1], maps, slope, kernels, values, winners, rewards, sums, rounds)
        return rewards, sums.sum(0).view(channels, 1, 3, 3), None


def unrolled(reward, kernels, rounds):
    value = torch.zeros_like(reward[:, :1])
    for _ in range(rounds):
        value = (reward + F.conv2d(value, kernels, padding=1)).amax(1, keepdim=True)
    return value


def value_iteration(reward, kernels, rounds):
    fits = reward.is_cuda and reward.dtype == torch.float32
    return (Fused.apply if fits else unrolled)(reward, kernels, rounds)


def check(device):
    """Relative difference of values and gradients between the fused kernels and automatic differentiation in double."""
    reward, slope = torch.randn(64, 10, SIDE, SIDE, device=device), torch.randn(64, 1, SIDE, SIDE, device=device)
    kernels = planning_kernels(10).to(device)
    results = []
    for kind in (torch.float32, torch.float64):
        inputs = [x.to(kind).clone().requires_grad_() for x in (reward, kernels)]
        value = value_iteration(*inputs, 36)
        (value * slope.to(kind)).sum().backward()
        results.append([value.detach(), inputs[0].grad, inputs[1].grad])
    off = [((a.double() - b).norm() / b.norm()).item() for a, b in zip(*results)]
    assert max(off) < 1e-3, off
    return off


def planning_kernels(channels):
    kernels = 0.02 * torch.randn(channels, 1, 3, 3)
    for q in range(channels):
        kernels[q, 0, q % 9 // 3, q % 3] += 0.95
    return kernels


def goal_features(cell):
    x, y = 2.35 - 0.1 * (cell // SIDE).float(), 1.35 - 0.1 * (cell % SIDE).float()
    distance = torch.hypot(x, y)
    return torch.stack([x, y, distance, x / distance, y / distance], 1)


class Network(nn.Module):
    """`rounds` of value iteration (0: none, the map alone), convolutions `(channels, stride)`, dense layers."""

    def __init__(self, rounds, convolutions, hidden, channels=10):
        super().__init__()
        self.rounds, size, (rows, cols) = rounds, 2 if rounds else 1, CROP_SIZE
        if rounds:
            reward = 0.02 * torch.randn(channels, 1, 3, 3)
            reward[:, 0, 1, 1] += 1.0
            self.reward, self.bias = nn.Parameter(reward), nn.Parameter(torch.zeros(channels))
            self.kernels = nn.Parameter(planning_kernels(channels))
        self.convolutions, self.dense = nn.ModuleList(), nn.ModuleList()
        for out, stride in convolutions:
            self.convolutions.append(nn.Conv2d(size, out, 3, stride=stride, padding=1))
            size, rows, cols = out, -(-rows // stride), -(-cols // stride)
        size = size * rows * cols + 7
        for out in hidden:
            self.dense.append(nn.Linear(size, out))
            size = out
        self.out = nn.Linear(size, 4)
        for layer in [*self.convolutions, *self.dense, self.out]:
            gain = 0.1 if layer is self.out else 1.0
            nn.init.normal_(layer.weight, std=gain * math.sqrt(2.0 / layer.weight[0].numel()))
            nn.init.zeros_(layer.bias)
        with torch.no_grad():
            self.out.bias[2:] = torch.tensor([-2.3, -1.6])

    def forward(self, cost, goal, velocity):
        maps = cost.shape[0]
        reward = -cost.float().view(maps, CELLS) / 255.0
        reward = reward.scatter_add(1, goal[:, None], torch.ones_like(reward[:, :1])).view(maps, 1, SIDE, SIDE)
        planes = reward
        if self.rounds:
            start = F.conv2d(reward, self.reward, self.bias, padding=1)
            value = value_iteration(start, self.kernels, self.rounds)
            value = 0.2 * (value - value[:, :, ROBOT[0], ROBOT[1]].mean((2, 3), keepdim=True))
            planes = torch.cat([value, reward], 1)
        planes = planes[:, :, CROP[0], CROP[1]]
        for layer in self.convolutions:
            planes = F.relu(layer(planes))
        features = torch.cat([planes.flatten(1), velocity, goal_features(goal)], 1)
        for layer in self.dense:
            features = F.relu(layer(features))
        return self.out(features)
