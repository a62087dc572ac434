"""Measures time and memory of the default experiment against its size, and writes docs/scale.md.

See README.md. Needs Linux, Python 3.9 or later, and nothing else.
"""

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MEASURED = Path(__file__).with_name("measured.json")
PAGE = ROOT / "docs" / "scale.md"
CONFIG = "configs/ablation.toml"
PROPERTIES = "fST fRS cYD cDP cRX cCM cDF tCO tPR mTX mCO mRG uCO uRO aTK".split()
# One rerun in the paper's protocol: nine tenths are trained on, a tenth is scored on.
COMMON = {"reruns": "1", "data.simulated.test-surfaces": "0"}


def surfaces(n):
    return {"data.simulated.surfaces": str(n), "data.simulated.views": "7"}, []


def views(n):
    settings = {
        "data.simulated.surfaces": "400",
        "data.simulated.views": str(n),
        "methods.full-chosen.views": "all",
    }
    return settings, ["full-chosen"]


def properties(n):
    return {**surfaces(400)[0], "properties": json.dumps(PROPERTIES[:n])}, []


# What grows, its settings, and the sizes that are measured.
SERIES = {
    "surfaces": (surfaces, [400, 1200, 4000, 12000, 40000]),
    "views": (views, [1, 3, 10, 30, 100]),
    "properties": (properties, [1, 5, 10, 15]),
}


def measure(program, settings, only):
    """Wall and processor seconds, and the peak of memory in MiB, of one experiment in empty folders."""
    with tempfile.TemporaryDirectory() as folder:
        settings = {**COMMON, **settings, "cache.folder": json.dumps(f"{folder}/cache")}
        command = [program, "experiment", CONFIG, "--out", f"{folder}/run"]
        for key, value in settings.items():
            command += ["--set", f"{key}={value}"]
        for method in only:
            command += ["--only", method]
        begun = time.monotonic()
        process = subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        log = process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.monotonic() - begun
        if status != 0:
            sys.exit(f"{' '.join(command)}\n{log}")
        return {
            "seconds": round(seconds, 1),
            "processor_seconds": round(usage.ru_utime + usage.ru_stime, 1),
            "mebibytes": round(usage.ru_maxrss / 1024),
        }


def law(points, key):
    """The line through the points whose squared errors, of what was measured, are least: its start,
    its slope, and its largest error as a share."""
    weights = [1 / point[key] ** 2 for point in points]
    sums = [sum(w * p["size"] ** k for w, p in zip(weights, points)) for k in range(3)]
    ones = sum(w * p[key] for w, p in zip(weights, points))
    products = sum(w * p[key] * p["size"] for w, p in zip(weights, points))
    slope = (sums[0] * products - sums[1] * ones) / (sums[0] * sums[2] - sums[1] ** 2)
    start = (ones - slope * sums[1]) / sums[0]
    errors = [abs(start + slope * p["size"] - p[key]) / p[key] for p in points]
    return start, slope, max(errors)


def count(number):
    return f"{number:,}"


def table(name, points):
    keys = [("seconds", "seconds"), ("mebibytes", "MiB")]
    lines = [
        f"| {name} | " + " | ".join(title for _, title in keys) + " |",
        "|---:|---:|---:|",
    ]
    for point in points:
        cells = [count(point["size"])] + [count(point[key]) for key, _ in keys]
        lines.append("| " + " | ".join(cells) + " |")
    lines.append("")
    formulas = [(title, *law(points, key)) for key, title in keys]
    lines.append(
        "; ".join(
            f"{title} = {start:.3g} + {slope:.3g} x {name} (within {100 * worst:.0f} %)"
            for title, start, slope, worst in formulas
        )
    )
    return "\n".join(lines)


def machine():
    with open("/proc/cpuinfo", encoding="utf-8") as info:
        models = re.findall(r"model name\s*: (.*)", info.read())
    return f"{models[0] if models else platform.processor()}, {os.cpu_count()} threads"


def page(measured):
    """The page with its tables as measured."""
    text = PAGE.read_text(encoding="utf-8")
    blocks = {"machine": measured["machine"]}
    for name in SERIES:
        blocks[name] = table(name, measured[name])
    for name, block in blocks.items():
        pattern = rf"(<!-- scale: {name} -->\n).*?(\n<!-- /scale -->)"
        text, found = re.subn(pattern, lambda m: m[1] + block + m[2], text, flags=re.DOTALL)
        if found != 1:
            sys.exit(f"{PAGE}: {found} places for {name}, expected 1")
    return text


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", nargs="?", help="xtask, built with --release; without it the page is written")
    parser.add_argument("--series", choices=SERIES, action="append", help="only these")
    parser.add_argument("--check", action="store_true", help="end with status 1 where the page differs")
    arguments = parser.parse_args()
    measured = json.loads(MEASURED.read_text()) if MEASURED.exists() else {}
    if arguments.program:
        program = str(Path(arguments.program).resolve())
        measured["machine"] = machine()
        for name in arguments.series or SERIES:
            settings, sizes = SERIES[name]
            measured[name] = []
            for size in sizes:
                point = {"size": size, **measure(program, *settings(size))}
                print(name, point, file=sys.stderr, flush=True)
                measured[name].append(point)
            MEASURED.write_text(json.dumps(measured, indent=1) + "\n")
    missing = [name for name in SERIES if name not in measured]
    if missing:
        sys.exit(f"{MEASURED.name} has no {', '.join(missing)}: {PAGE} is not written")
    text = page(measured)
    if arguments.check:
        if text != PAGE.read_text(encoding="utf-8"):
            sys.exit(f"{PAGE} is not what {MEASURED.name} gives: run {Path(__file__).name} without arguments")
    else:
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
