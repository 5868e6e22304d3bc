#!/usr/bin/env python3
"""The same deaths beside dora: a camera, a relay in the place of vision, and a sink in the place of the arm, as dora
nodes with its restart policy; each of the first two is killed with SIGKILL again and again. Then `pursuit chaos
--faults kill` on the same machine. Printed of both: from the kill to the next frame at the other end, and frames
that never came.

    python3 -m venv .venv && .venv/bin/pip install dora-rs==1.1.0 dora-rs-cli==1.1.0 pyarrow
    .venv/bin/python ops/deaths.py [--kills 20] [--pursuit target/release/pursuit] [--json FILE]

dora's nodes are Python here, as its packages bring them: starting one takes an interpreter's time, which is its
own affair and not dora's; the figures say what its users have.
"""
import argparse
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PERIOD_NS = 40_000_000
FRAME_BYTES = 512 * 512

CAMERA = """
import os, time
import pyarrow as pa
from dora import Node
open("camera.pid", "w").write(str(os.getpid()))
node = Node()
buffer = pa.py_buffer(bytes({bytes}))
for event in node:
    if event["type"] == "INPUT":
        # The timer beats on while the camera is dead: frames have numbers by the clock.
        number = time.monotonic_ns() // {period}
        image = pa.Array.from_buffers(pa.uint8(), {bytes}, [None, buffer])
        node.send_output("image", image, {{"frame": number, "sent": time.monotonic_ns()}})
"""

RELAY = """
import os, time
import pyarrow as pa
from dora import Node
open("relay.pid", "w").write(str(os.getpid()))
node = Node()
for event in node:
    if event["type"] == "INPUT":
        told = event["metadata"]
        node.send_output("target", pa.array([1.0]), {"frame": told["frame"], "sent": time.monotonic_ns()})
"""

SINK = """
import os, time
from dora import Node
open("sink.pid", "w").write(str(os.getpid()))
log = open("sink.log", "a", buffering=1)
node = Node()
for event in node:
    if event["type"] == "INPUT":
        told = event["metadata"]
        now = time.monotonic_ns()
        log.write(f"{told['frame']} {now} {now - told['sent']}\\n")
"""

DATAFLOW = """
nodes:
  - id: camera
    path: camera.py
    restart_policy: on-failure
    inputs:
      tick: dora/timer/millis/40
    outputs: [image]
  - id: relay
    path: relay.py
    restart_policy: on-failure
    inputs:
      image: camera/image
    outputs: [target]
  - id: sink
    path: sink.py
    inputs:
      target: relay/target
"""


def arrivals(folder):
    """Frame, time of arrival and latency of the last hop, ns, of each line of the sink."""
    lines = (folder / "sink.log").read_text().splitlines() if (folder / "sink.log").exists() else []
    return [tuple(int(word) for word in line.split()) for line in lines if len(line.split()) == 3]


def wait_for(what, seconds=60):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = what()
        if found:
            return found
        time.sleep(0.02)
    return None


def of_dora(kills, program):
    """Gaps in ms and lost frames after each kill, by node; `None` where it does not run."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        camera = CAMERA.format(bytes=FRAME_BYTES, period=PERIOD_NS)
        for file, text in [("camera.py", camera), ("relay.py", RELAY), ("sink.py", SINK), ("flow.yml", DATAFLOW)]:
            (folder / file).write_text(text)
        environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
        log = open(folder / "dora.log", "w")
        flow = subprocess.Popen([program, "run", "flow.yml"], cwd=folder, env=environment, stdout=log,
                                stderr=log, start_new_session=True)
        try:
            if not wait_for(lambda: len(arrivals(folder)) > 25):
                print((folder / "dora.log").read_text()[-2000:], file=sys.stderr)
                return None
            outcome = {"camera": [], "relay": []}
            for kill in range(kills):
                node = ("camera", "relay")[kill % 2]
                time.sleep(1.5 + random.random())
                pid = int((folder / f"{node}.pid").read_text())
                before = len(arrivals(folder))
                killed = time.monotonic_ns()
                os.kill(pid, signal.SIGKILL)
                came = wait_for(lambda: [a for a in arrivals(folder)[before:] if a[0] * PERIOD_NS > killed], 30)
                if not came:
                    outcome[node].append((None, None))
                    print(f"dora: nothing came after the {node} was killed", file=sys.stderr)
                    break
                time.sleep(1.0)
                seen = {a[0] for a in arrivals(folder)}
                first = killed // PERIOD_NS
                last = max(seen)
                lost = sum(1 for frame in range(first, last) if frame not in seen)
                outcome[node].append(((came[0][1] - killed) / 1e6, lost))
            hops = sorted(a[2] / 1e3 for a in arrivals(folder))
            return outcome, hops[len(hops) // 2], hops[int(0.99 * len(hops))]
        finally:
            os.killpg(flow.pid, signal.SIGKILL)
            flow.wait()


def of_pursuit(kills, program):
    with tempfile.TemporaryDirectory() as name:
        figures = Path(name) / "figures.json"
        seconds = str(max(30, int(kills * 2.3 * 3)))
        command = [program, "chaos", "--faults", "kill", "--seconds", seconds, "--run-dir", f"{name}/run",
                   "--json", str(figures)]
        subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
        costs = json.loads(figures.read_text())["costs"]
    outcome = {"acquisition": [], "vision": []}
    for cost in costs:
        service = cost["fault"].split()[-1]
        if service in outcome and cost["reborn_ms"] is not None and cost["unanswered"] is not None:
            outcome[service].append((cost["reborn_ms"], cost["unanswered"]))
    return outcome


def row(name, pairs):
    gaps = sorted(gap for gap, _ in pairs if gap is not None)
    lost = sorted(count for _, count in pairs if count is not None)
    if not gaps:
        print(f"  {name:<22} did not come back")
        return
    print(f"  {name:<22} gap {statistics.median(gaps):6.0f} / {gaps[-1]:6.0f} ms   lost frames "
          f"{statistics.median(lost):4.0f} / {lost[-1]:4.0f}   ({len(pairs)} kills)")


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--kills", type=int, default=20)
    arguments.add_argument("--dora", default=str(Path(sys.executable).parent / "dora"))
    arguments.add_argument("--pursuit", default="target/release/pursuit")
    arguments.add_argument("--json", type=Path)
    options = arguments.parse_args()
    dora = of_dora(options.kills, options.dora)
    pursuit = of_pursuit(options.kills, options.pursuit)
    print("after a SIGKILL, median / worst:")
    if dora:
        outcome, p50, p99 = dora
        for node, pairs in outcome.items():
            row(f"dora, {node}", pairs)
        print(f"  dora, one hop of a small message: p50 {p50:.0f}, p99 {p99:.0f} us")
    else:
        print("  dora did not run: is it installed?")
    for service, pairs in pursuit.items():
        row(f"pursuit, {service}", pairs)
    if options.json:
        options.json.write_text(json.dumps({"dora": dora, "pursuit": pursuit}, indent=1))


if __name__ == "__main__":
    main()
