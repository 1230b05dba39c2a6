# What Python's safetensors makes of a policy file, and ONNX Runtime of its ONNX model, as JSON:
#     read_policy.py POLICY.safetensors MODEL.onnx OBSERVATIONS
import json
import sys

import numpy
import onnxruntime
import safetensors
import safetensors.numpy

policy, model, observations = sys.argv[1:]
tensors = safetensors.numpy.load_file(policy)
with safetensors.safe_open(policy, "numpy") as file:
    metadata = file.metadata()
golden = tensors["golden.observation"]
batch = numpy.fromfile(observations, numpy.uint8).reshape(-1, *golden.shape)
options = onnxruntime.SessionOptions()
options.intra_op_num_threads = 1
session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
action, output = session.run(["action", "output"], {"observation": batch})
json.dump(
    {
        "tensors": {name: [str(tensor.dtype), list(tensor.shape)] for name, tensor in tensors.items()},
        "sums": {name: float(numpy.sum(tensor, dtype=numpy.float64)) for name, tensor in tensors.items()},
        "metadata": metadata,
        "model": session.get_modelmeta().custom_metadata_map,
        "action": action.tolist(),
        "output": output.tolist(),
    },
    sys.stdout,
)
