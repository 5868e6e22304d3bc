#!/usr/bin/env python3
"""One hop beside dora: a frame from the process that made it to the next one, us. dora's nodes are Rust and do nothing
but send and receive; pursuit is the whole system at work, the frame rendered into shared memory and taken by vision.
Same machine, same sizes of frames, 25 frames a second, ordinary priority, in alternation.

    python3 -m venv .venv && .venv/bin/pip install dora-rs-cli==1.1.0
    .venv/bin/python ops/hops.py [--seconds 20] [--rounds 2] [--pursuit target/release/pursuit] [--json FILE]

Needs cargo, which builds dora's node library (some minutes, in a temporary folder, or in --build FOLDER).
"""
import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SIZES = {"256 KiB": (512, 512), "1.25 MiB": (1280, 1024)}
RATE_HZ = 25

CARGO = """
[package]
name = "hop"
version = "0.0.0"
edition = "2024"
[dependencies]
dora-node-api = { version = "=1.1.0", default-features = false }
[workspace]
"""

NODE = """
use dora_node_api::{DoraNode, Event, Parameter, dora_core::config::DataId};
use std::io::Write;
use std::time::{SystemTime, UNIX_EPOCH};

fn now() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as i64
}

fn main() {
    let words: Vec<String> = std::env::args().collect();
    let (mut node, mut events) = DoraNode::init_from_env().unwrap();
    if words[1] == "camera" {
        let bytes: usize = words[2].parse().unwrap();
        let mut count = 0u8;
        while let Some(event) = events.recv() {
            if let Event::Input { .. } = event {
                count = count.wrapping_add(1);
                let mut told = std::collections::BTreeMap::new();
                let image = DataId::from("image".to_owned());
                // Sent when the pixels are there, as pursuit counts.
                let sent = |told: &mut std::collections::BTreeMap<_, _>| {
                    told.insert("sent".to_owned(), Parameter::Integer(now()));
                };
                sent(&mut told);
                node.send_output_raw(image, told, bytes, |out| out[..64].fill(count)).unwrap();
            }
        }
    } else {
        let mut log = std::fs::File::create("sink.log").unwrap();
        while let Some(event) = events.recv() {
            if let Event::Input { metadata, .. } = event {
                let came = now();
                if let Some(Parameter::Integer(sent)) = metadata.parameters.get("sent") {
                    writeln!(log, "{}", came - sent).unwrap();
                }
            }
        }
    }
}
"""

DATAFLOW = """
nodes:
  - id: camera
    path: ./hop
    args: camera {bytes}
    inputs:
      tick: dora/timer/millis/{period}
    outputs: [image]
  - id: sink
    path: ./hop
    args: sink
    inputs:
      image: camera/image
"""


def build(folder):
    (folder / "src").mkdir(parents=True, exist_ok=True)
    (folder / "Cargo.toml").write_text(CARGO)
    (folder / "src" / "main.rs").write_text(NODE)
    subprocess.run(["cargo", "build", "--release", "--quiet"], cwd=folder, check=True)
    return folder / "target" / "release" / "hop"


def of_dora(program, hop, size, seconds):
    """Times of all hops after the first second, us."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hop").symlink_to(hop)
        (folder / "flow.yml").write_text(DATAFLOW.format(bytes=size[0] * size[1], period=1000 // RATE_HZ))
        with open(folder / "dora.log", "w") as log:
            flow = subprocess.Popen([program, "run", "flow.yml"], cwd=folder, stdout=log, stderr=log,
                                    start_new_session=True)
            try:
                time.sleep(seconds + 3)
            finally:
                os.killpg(flow.pid, signal.SIGKILL)
                flow.wait()
        lines = (folder / "sink.log").read_text().splitlines() if (folder / "sink.log").exists() else []
        if len(lines) < 2 * RATE_HZ:
            print((folder / "dora.log").read_text()[-2000:], file=sys.stderr)
        return sorted(int(line) / 1e3 for line in lines[RATE_HZ:-1])


def of_pursuit(program, size, seconds):
    """p50 and p99 of the waiting at the hop to vision, us, and how many frames."""
    with tempfile.TemporaryDirectory() as name:
        place = ["--run-dir", f"{name}/run"]
        sets = {"run.clock": "wall", "simulator.frames": 0, "camera.width": size[0], "camera.height": size[1],
                "camera.focal_px": size[0] / 2, "camera.rate_hz": float(RATE_HZ), "learner.training_moves": 4}
        words = [word for key, value in sets.items() for word in ("--set", f"{key}={json.dumps(value)}")]
        system = subprocess.Popen([program, "up", *place, *words], stdout=subprocess.DEVNULL,
                                  stderr=subprocess.DEVNULL)
        try:
            time.sleep(8)
            told = subprocess.run([program, "trace", *place, "--seconds", str(seconds), "--json", "-"],
                                  capture_output=True, text=True, check=True)
        finally:
            subprocess.run([program, "down", *place], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                           check=False)
            system.wait()
    hops = json.loads(told.stdout)
    hop = next(hop for hop in hops["hops"] if hop["to"] == "vision")
    return hop["wait_us"]["p50"], hop["wait_us"]["p99"], hops["frames"]["captured"]


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--seconds", type=int, default=20)
    arguments.add_argument("--rounds", type=int, default=2)
    arguments.add_argument("--build", type=Path)
    arguments.add_argument("--dora", default=str(Path(sys.executable).parent / "dora"))
    arguments.add_argument("--pursuit", default="target/release/pursuit")
    arguments.add_argument("--json", type=Path)
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory() as name:
        hop = build((options.build or Path(name)).resolve())
        rows = []
        print(f"one hop, us, {RATE_HZ} frames a second:")
        for number in range(options.rounds):
            for label, size in SIZES.items():
                times = of_dora(options.dora, hop, size, options.seconds)
                if times:
                    rows.append(("dora", label, times[len(times) // 2], times[int(0.99 * len(times))], len(times)))
                rows.append(("pursuit", label, *of_pursuit(options.pursuit, size, options.seconds)))
                for system, label_, p50, p99, count in rows[-2:] if times else rows[-1:]:
                    print(f"  {system:<8} {label_:<9} p50 {p50:7.0f}  p99 {p99:7.0f}   ({count} frames)", flush=True)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
