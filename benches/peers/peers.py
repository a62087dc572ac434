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


def unit(inputs, outputs, size, stride=1):
    """Convolution, batch norm and rectifier of I3D, padded so that the stride alone decides the extents of a map of
    an even number of frames, rows and columns."""
    padding = [(size - stride) // 2, -(-(size - stride) // 2)] * 3 if stride > 1 else [size // 2] * 6
    return torch.nn.Sequential(
        torch.nn.ConstantPad3d(padding, 0.0),
        torch.nn.Conv3d(inputs, outputs, size, stride, bias=False),
        torch.nn.BatchNorm3d(outputs, eps=1e-3),
        torch.nn.ReLU(),
    )


class Mixed(torch.nn.Module):
    """Four branches of I3D side by side: channels of the six units."""

    def __init__(self, inputs, outputs):
        super().__init__()
        b0, b1a, b1b, b2a, b2b, b3b = outputs
        self.branches = torch.nn.ModuleList([
            unit(inputs, b0, 1),
            torch.nn.Sequential(unit(inputs, b1a, 1), unit(b1a, b1b, 3)),
            torch.nn.Sequential(unit(inputs, b2a, 1), unit(b2a, b2b, 3)),
            torch.nn.Sequential(torch.nn.MaxPool3d(3, 1, 1), unit(inputs, b3b, 1)),
        ])

    def forward(self, x):
        return torch.cat([branch(x) for branch in self.branches], 1)


def i3d():
    """Carreira and Zisserman, CVPR 2017."""

    def pool(size, stride):
        padding = [p for k, s in zip(reversed(size), reversed(stride)) for p in ((k - s) // 2, -(-(k - s) // 2))]
        return [torch.nn.ConstantPad3d(padding, 0.0), torch.nn.MaxPool3d(size, stride)]

    spatial, all_axes = ((1, 3, 3), (1, 2, 2)), ((3, 3, 3), (2, 2, 2))
    return torch.nn.Sequential(
        unit(3, 64, 7, 2), *pool(*spatial), unit(64, 64, 1), unit(64, 192, 3), *pool(*spatial),
        Mixed(192, (64, 96, 128, 16, 32, 32)), Mixed(256, (128, 128, 192, 32, 96, 64)), *pool(*all_axes),
        Mixed(480, (192, 96, 208, 16, 48, 64)), Mixed(512, (160, 112, 224, 24, 64, 64)),
        Mixed(512, (128, 128, 256, 24, 64, 64)), Mixed(512, (112, 144, 288, 32, 64, 64)),
        Mixed(528, (256, 160, 320, 32, 128, 128)), torch.nn.MaxPool3d(2, 2, ceil_mode=True),
        Mixed(832, (256, 160, 320, 32, 128, 128)), Mixed(832, (384, 192, 384, 48, 128, 128)),
    )


# Our name of a network, and the same one with untrained weights, without its classifier.
NETWORKS = {
    "squeezenet1-0": lambda: torchvision.models.squeezenet1_0().features,
    "efficientnet-lite0": lambda: features(timm.create_model("tf_efficientnet_lite0")),
    "resnet18": lambda: features(timm.create_model("resnet18")),
    "resnet50": lambda: features(timm.create_model("resnet50")),
    "se-resnext50-32x4d": lambda: features(timm.create_model("legacy_seresnext50_32x4d")),
    "i3d": i3d,
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
        return self.network(images).flatten(2).mean(2)


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
    channels_last = torch.channels_last if images.dim() == 4 else torch.channels_last_3d
    if what.startswith("training"):
        network = network.train().to(memory_format=channels_last)
        images = images.to(memory_format=channels_last)

        def step():
            network.zero_grad()
            # As is usual: weights stay f32, convolutions compute in bf16.
            with torch.autocast("cpu", torch.bfloat16, enabled=what == "training-bf16"):
                loss = network(images).float().square().mean()
            loss.backward()

        return Peer(len(images), step)
    network.eval()
    dtype = torch.bfloat16 if what == "bf16" else torch.float32
    network = network.to(dtype, memory_format=channels_last)
    images = images.to(dtype, memory_format=channels_last)

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
    images = torch.rand(batch, 3, *([16, 112, 112] if name == "i3d" else [224, 224]))
    runs = {"here": Ours(arguments, name, what, batch)}
    if what != "int8":
        runs["pytorch"] = pytorch(Embedding(NETWORKS[name]()), images, what)
    if not what.startswith("training"):
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
    # The others have no bf16x2: beside it they run in f32.
    kinds = ["f32", "bf16x2", "bf16", "int8", "training-f32", "training-bf16"]
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=kinds)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    logging.getLogger("nncf").setLevel(logging.WARNING)
    print(f"{arguments.threads} threads; PyTorch {torch.__version__}, OpenVINO {openvino.__version__}\n")
    print("| network | | batch | here | OpenVINO | PyTorch | here / OpenVINO | here / PyTorch |")
    print("|---|---|---:|---:|---:|---:|---:|---:|")
    for name in arguments.networks:
        for what in arguments.kinds:
            for batch in [8] if what.startswith("training") else [1, 8]:
                found = measure(arguments, name, what, batch)
                here = found["here"]
                peers = [found.get(library) for library in ("openvino", "pytorch")]
                cells = [f"{peer:.2f}" if peer else "" for peer in peers]
                cells += [f"{here / peer:.2f}" if peer else "" for peer in peers]
                print(f"| {name} | {what} | {batch} | {here:.2f} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
