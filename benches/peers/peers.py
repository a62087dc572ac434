"""Times the encoders of sps-models beside OpenVINO and PyTorch: every library in turn, pass by pass.

See README.md. Prints a table of medians in milliseconds a frame, and ratios to the same run's peers.
"""

import argparse
import contextlib
import logging
import os
import statistics
import subprocess
import sys
import time

import numpy
import openvino
import timm
import torch
import torchvision

# Our name of a network, and the same one with untrained weights, without its classifier.
NETWORKS = {
    "squeezenet1-0": lambda: torchvision.models.squeezenet1_0().features,
    "efficientnet-lite0": lambda: features(timm.create_model("tf_efficientnet_lite0")),
    "resnet18": lambda: features(timm.create_model("resnet18")),
    "resnet50": lambda: features(timm.create_model("resnet50")),
    "se-resnext50-32x4d": lambda: features(timm.create_model("legacy_seresnext50_32x4d")),
}


def features(model):
    """Without pooling and classifier; of EfficientNet with its last convolution, as here."""
    model.reset_classifier(0, "")
    return model


class Embedding(torch.nn.Module):
    """The mean of the last feature map over space."""

    def __init__(self, network):
        super().__init__()
        self.network = network

    def forward(self, images):
        return self.network(images).mean((2, 3))


class Ours:
    """The kernels of sps-models, in a process of their own."""

    def __init__(self, arguments, name, what, batch):
        command = [arguments.program, name, what, str(batch)]
        environment = {**os.environ, "RAYON_NUM_THREADS": str(arguments.threads)}
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )

    def milliseconds(self):
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline())

    def close(self):
        self.process.stdin.close()
        self.process.wait()


class Peer:
    """A function of no argument, run after one pass to warm up."""

    def __init__(self, batch, run):
        self.batch, self.run = batch, run
        run()

    def milliseconds(self):
        start = time.perf_counter()
        self.run()
        return 1e3 * (time.perf_counter() - start) / self.batch

    def close(self):
        pass


def pytorch(network, images, what):
    if what == "training":
        network.train()

        def step():
            network.zero_grad()
            network(images).square().mean().backward()

        return Peer(len(images), step)
    network.eval()
    dtype = {"f32": torch.float32, "bf16": torch.bfloat16}[what]
    network = network.to(dtype, memory_format=torch.channels_last)
    images = images.to(dtype, memory_format=torch.channels_last)

    def forward():
        with torch.inference_mode():
            network(images)

    return Peer(len(images), forward)


def open_vino(network, images, what, threads):
    network.eval()
    model = openvino.convert_model(network, example_input=images[:1])
    model.reshape(list(images.shape))
    if what == "int8":
        import nncf

        calibration = nncf.Dataset(numpy.split(images.numpy(), len(images)))
        one = openvino.convert_model(network, example_input=images[:1])
        one.reshape([1, *images.shape[1:]])
        # Its progress is no row of the table.
        with contextlib.redirect_stdout(sys.stderr):
            model = nncf.quantize(one, calibration, subset_size=len(images))
        model.reshape(list(images.shape))
    settings = {
        "PERFORMANCE_HINT": "LATENCY",
        "INFERENCE_NUM_THREADS": threads,
        "INFERENCE_PRECISION_HINT": "bf16" if what == "bf16" else "f32",
    }
    request = openvino.Core().compile_model(model, "CPU", settings).create_infer_request()
    images = images.numpy()
    return Peer(len(images), lambda: request.infer([images]))


def measure(arguments, name, what, batch):
    """Medians over rounds, in each of which every library runs once."""
    torch.manual_seed(0)
    images = torch.rand(batch, 3, 224, 224)
    runs = {"here": Ours(arguments, name, what, batch)}
    if what != "int8":
        runs["pytorch"] = pytorch(Embedding(NETWORKS[name]()), images, what)
    if what != "training":
        network = Embedding(NETWORKS[name]())
        runs["openvino"] = open_vino(network, images, what, arguments.threads)
    times = {library: [] for library in runs}
    for _ in range(arguments.rounds):
        for library, run in runs.items():
            times[library].append(run.milliseconds())
    for run in runs.values():
        run.close()
    return {library: statistics.median(found) for library, found in times.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", help="target/release/examples/time_encoder")
    parser.add_argument("--rounds", type=int, default=31)
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--networks", nargs="+", choices=NETWORKS, default=list(NETWORKS))
    kinds = ["f32", "bf16", "int8", "training"]
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=kinds)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    logging.getLogger("nncf").setLevel(logging.WARNING)
    print(f"{arguments.threads} threads; PyTorch {torch.__version__}, OpenVINO {openvino.__version__}\n")
    print("| network | | batch | here | OpenVINO | PyTorch | here / OpenVINO | here / PyTorch |")
    print("|---|---|---:|---:|---:|---:|---:|---:|")
    for name in arguments.networks:
        for what in arguments.kinds:
            for batch in [8] if what == "training" else [1, 8]:
                found = measure(arguments, name, what, batch)
                here = found["here"]
                peers = [found.get(library) for library in ("openvino", "pytorch")]
                cells = [f"{peer:.2f}" if peer else "" for peer in peers]
                cells += [f"{here / peer:.2f}" if peer else "" for peer in peers]
                print(f"| {name} | {what} | {batch} | {here:.2f} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
