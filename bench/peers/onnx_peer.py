"""Milliseconds per batch of decisions of ONNX Runtime on one thread: one JSON line.
     onnx_peer.py MODEL BATCH"""
import sys

import numpy as np
import onnxruntime
from measure import milliseconds, report

model, batch = sys.argv[1], int(sys.argv[2])
options = onnxruntime.SessionOptions()
options.intra_op_num_threads = options.inter_op_num_threads = 1
session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
observations = np.random.default_rng(1).integers(256, size=(batch, 4, 84, 84), dtype=np.uint8)
report(ms=milliseconds(lambda: session.run(["action"], {"observation": observations})))
