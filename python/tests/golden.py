"""The rule by which `fixtures/golden/make_golden.py` fills weights and inputs."""

import math

import numpy as np


def uniform(name, shape):
    """Values in [-1, 1): FNV-1a of the name seeds SplitMix64."""
    seed = 0xCBF29CE484222325
    for byte in name.encode():
        seed = ((seed ^ byte) * 0x100000001B3) % 2**64
    with np.errstate(over="ignore"):
        steps = np.arange(1, math.prod(shape) + 1, dtype=np.uint64)
        z = np.uint64(seed) + steps * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return ((z >> np.uint64(40)).astype(np.float64) / 2**23 - 1).reshape(shape)


def squeezenet():
    """The weights of torchvision's `squeezenet1_0` without its classifier."""
    fires = {3: (96, 16, 64), 4: (128, 16, 64), 5: (128, 32, 128), 7: (256, 32, 128)}
    fires |= {8: (256, 48, 192), 9: (384, 48, 192), 10: (384, 64, 256), 12: (512, 64, 256)}
    shapes = {"features.0": (96, 3, 7, 7)}
    for place, (inputs, squeezed, expanded) in fires.items():
        shapes[f"features.{place}.squeeze"] = (squeezed, inputs, 1, 1)
        shapes[f"features.{place}.expand1x1"] = (expanded, squeezed, 1, 1)
        shapes[f"features.{place}.expand3x3"] = (expanded, squeezed, 3, 3)
    weights = {}
    for name, shape in shapes.items():
        scale = math.sqrt(3 / math.prod(shape[1:]))
        weights[f"{name}.weight"] = uniform(f"{name}.weight", shape) * scale
        weights[f"{name}.bias"] = uniform(f"{name}.bias", shape[:1]) * 0.1
    return weights
