"""Many clients ask a service, some of them badly.

    python3 benches/serve/load.py target/release/sps MODEL_DIR PHOTOGRAPH...

Starts `sps serve`, asks it --requests times by --clients clients, and compares each good answer with what `sps
predict --json` says. One request in twenty has a broken, oversized, slow or cut-off body, and must have its status.
Prints the median and the 99th percentile of the time of good answers, and the service's resident memory before and
after. Ends with status 1 where an answer is not as expected. Needs Linux, and Python without packages.
"""

import argparse
import http.client
import json
import os
import signal
import socket
import statistics
import subprocess
import sys
import threading
import time

MAX_BODY = 4 << 20
TIMEOUT = 2
BAD = ["broken", "oversized", "slow", "cut off"]
STATUS = {"good": 200, "broken": 400, "oversized": 413, "slow": 408}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sps")
    parser.add_argument("model")
    parser.add_argument("photographs", nargs="+")
    parser.add_argument("--requests", type=int, default=10_000)
    parser.add_argument("--clients", type=int, default=64)
    return parser.parse_args()


def predicted(sps, model, photograph):
    command = [sps, "predict", "--json", model, photograph]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["estimates"]


def resident(process):
    with open(f"/proc/{process.pid}/status") as status:
        line = next(line for line in status if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


class Client(threading.Thread):
    def __init__(self, address, photographs, expected, numbers):
        super().__init__()
        self.address, self.photographs, self.expected, self.numbers = address, photographs, expected, numbers
        self.connection = http.client.HTTPConnection(*address, timeout=120)
        self.seconds, self.wrong, self.counts = [], [], {}

    def run(self):
        for number in self.numbers:
            kind = BAD[number // 20 % len(BAD)] if number % 20 == 0 else "good"
            self.counts[kind] = self.counts.get(kind, 0) + 1
            try:
                problem = self.ask(kind, number % len(self.photographs))
            except Exception as error:
                problem = repr(error)
                self.connection.close()
            if problem:
                self.wrong.append(f"request {number}, {kind}: {problem}")

    def ask(self, kind, at):
        photograph = self.photographs[at]
        if kind == "cut off":
            self.begin(photograph).close()
            return None
        if kind == "slow":
            # It outlasts the time for which a connection may wait for its next request.
            self.connection.close()
            with self.begin(photograph) as connection:
                status = int(connection.makefile("rb").readline().split()[1])
        else:
            body = {"good": photograph, "broken": photograph[: len(photograph) // 2], "oversized": bytes(MAX_BODY + 1)}
            began = time.monotonic()
            self.connection.request("POST", "/predict", body[kind], {"content-type": "application/octet-stream"})
            response = self.connection.getresponse()
            status, answer = response.status, json.loads(response.read())
            if kind == "good" and status == 200:
                self.seconds.append(time.monotonic() - began)
                if answer["estimates"] != self.expected[at]:
                    return f"found {answer['estimates']}, expected {self.expected[at]}"
        return None if status == STATUS[kind] else f"found {status}, expected {STATUS[kind]}"

    def begin(self, photograph):
        """A connection with the first half of a request."""
        connection = socket.create_connection(self.address, timeout=120)
        head = f"POST /predict HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-length: {len(photograph)}\r\n\r\n"
        connection.sendall(head.encode() + photograph[: len(photograph) // 2])
        return connection


def main():
    args = arguments()
    expected = [predicted(args.sps, args.model, photograph) for photograph in args.photographs]
    photographs = [open(photograph, "rb").read() for photograph in args.photographs]
    command = [args.sps, "serve", args.model, "--listen", "127.0.0.1:0", "--at-once", str(2 * args.clients)]
    command += ["--timeout", str(TIMEOUT), "--max-body", str(MAX_BODY >> 20)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        host, port = process.stdout.readline().strip().removeprefix("http://").split(":")
        address = (host, int(port))
        warm = Client(address, photographs, expected, range(1, 20))
        warm.run()
        before = resident(process)
        shares = [range(at, args.requests, args.clients) for at in range(args.clients)]
        clients = [Client(address, photographs, expected, share) for share in shares]
        began = time.monotonic()
        for client in clients:
            client.start()
        for client in clients:
            client.join()
        took = time.monotonic() - began
        after = resident(process)
        process.send_signal(signal.SIGTERM)
        status = process.wait(60)
    wrong = [problem for client in [warm, *clients] for problem in client.wrong]
    counts = {kind: sum(client.counts.get(kind, 0) for client in clients) for kind in ["good", *BAD]}
    seconds = [second for client in clients for second in client.seconds]
    alone = statistics.median(warm.seconds)
    p99 = statistics.quantiles(seconds, n=100)[98]
    print(", ".join(f"{count} {kind}" for kind, count in counts.items()), f"in {took:.1f} s on {os.cpu_count()} cores")
    print(f"one client: median {1000 * alone:.1f} ms")
    print(f"{args.clients} clients: median {1000 * statistics.median(seconds):.1f} ms, p99 {1000 * p99:.1f} ms")
    print(f"resident memory: {before:.0f} MiB before, {after:.0f} MiB after")
    for problem in wrong[:20]:
        print(problem)
    print(f"{len(wrong)} answers are not as expected; the service ended with status {status}")
    sys.exit(1 if wrong or status else 0)


if __name__ == "__main__":
    main()
