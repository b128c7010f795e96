"""Checks a policy file with onnx and compares its recorded self-test with onnxruntime's answer."""
import sys

import numpy
import onnx
import onnxruntime

model = onnx.load(sys.argv[1])
onnx.checker.check_model(model, full_check=True)
props = {p.key: p.value for p in model.metadata_props}
cost = numpy.frombuffer(bytes.fromhex(props["sidestep.golden.planning_cost"]), numpy.uint8)
goal = numpy.zeros(784, numpy.float32)
goal[int(props["sidestep.golden.goal_cell"])] = 1
pair = lambda key: numpy.array([float(x) for x in props["sidestep.golden." + key].split()], numpy.float32)
session = onnxruntime.InferenceSession(sys.argv[1], providers=["CPUExecutionProvider"])
inputs = {
    "planning_cost": (cost.astype(numpy.float32) / 255).reshape(1, 1, 28, 28),
    "goal": goal.reshape(1, 1, 28, 28),
    "velocity": pair("velocity").reshape(1, 2),
}
command, doubt = session.run(["command", "doubt"], inputs)
difference = max(abs(command[0] - pair("command")).max(), abs(doubt[0] - pair("doubt")).max())
print("onnxruntime differs by", difference)
assert difference < 1e-5, (command, doubt, props)
