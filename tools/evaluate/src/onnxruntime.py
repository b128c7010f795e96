"""Prints the median time in us of one answer of a policy file in onnxruntime, on one core."""
import sys
import time

import numpy
import onnxruntime

options = onnxruntime.SessionOptions()
options.intra_op_num_threads = 1
options.inter_op_num_threads = 1
session = onnxruntime.InferenceSession(sys.argv[1], options, providers=["CPUExecutionProvider"])
random = numpy.random.default_rng(1)
goal = numpy.zeros((1, 1, 28, 28), numpy.float32)
goal[0, 0, 3, 14] = 1
inputs = {
    "planning_cost": random.random((1, 1, 28, 28), numpy.float32),
    "goal": goal,
    "velocity": numpy.array([[0.5, 0.1]], numpy.float32),
}
times = []
for _ in range(205):
    begin = time.perf_counter_ns()
    session.run(["command", "doubt"], inputs)
    times.append(time.perf_counter_ns() - begin)
print(sorted(times[5:])[100] * 1e-3)
