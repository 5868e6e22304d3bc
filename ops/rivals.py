#!/usr/bin/env python3
"""What ready-made parts of OpenCV find in pursuit's test sequences, judged as pursuit's own detectors are.

    pursuit experiment robustness --seeds 1 --sizes 512 --frames pursuit-out/frames --json pursuit.json
    python3 ops/rivals.py pursuit-out/frames --pursuit pursuit.json

Rivals, each on one thread:
    DIS affine     DIS optical flow (ultrafast), robust fit of an affine motion, blob of what moves otherwise
    DIS quadratic  the same with the flow of a plane under any motion of the camera (8 coefficients)
    LK difference  corners, pyramidal Lucas-Kanade, RANSAC homography, absolute difference, blob
Their thresholds were set on these very sequences, in their favour.

Needs Python 3.11 or newer: pip install numpy opencv-python-headless
"""

import argparse
import json
import sys
import time
from pathlib import Path

try:
    import cv2
    import numpy as np
except ImportError as error:
    sys.exit(f"ops/rivals.py: {error}; install what is missing: pip install numpy opencv-python-headless")

# The judgement, as in services/robustness/judge.rs.
BORDER = 0.03
MOVING_PX = 0.5
RESTING_PX = 0.1
LEAST_AREA_PX = 20.0
SHARE_OF_SIZE = 0.5
SHARE_OF_SIDE = 0.02
SHARE_KNOWN = 0.06

# A target covers between these shares of the frame.
LEAST_SHARE = 1 / 4000
MOST_SHARE = 1 / 8


class Flow:
    """Dense flow, dominant motion, residual."""

    CELL = 4  # px between the flow vectors that are looked at
    FIT_EVERY = 2  # of these, every so many in each direction take part in the fit
    STEPS = 6
    MARGIN = 0.047  # share of a side along the border where the flow is not to be trusted
    LEAST_RESIDUAL_PX = 0.8
    SCALES = 5.0  # residual of a target, in standard deviations of the background's

    def __init__(self, quadratic):
        self.quadratic = quadratic
        self.flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
        self.basis = None

    def step(self, older, newer):
        """Position and velocity of what moves, or None, and the seconds that the flow took."""
        start = time.perf_counter()
        # from the newer frame back, so that what is found lies where it is in the newer one
        flow = -self.flow.calc(newer, older, None)
        flow_s = time.perf_counter() - start
        cell = self.CELL
        flow = np.ascontiguousarray(flow[cell // 2 :: cell, cell // 2 :: cell], dtype=np.float32)
        if self.basis is None:
            self.basis = self.basis_on(*flow.shape[:2])
        background, scale = self.dominant_motion(flow)
        left = flow - background
        residual = cv2.GaussianBlur(np.hypot(left[..., 0], left[..., 1]), (0, 0), 1.0)
        residual[self.entered(background, newer.shape)] = 0
        blob = largest_blob(residual, max(self.LEAST_RESIDUAL_PX, self.SCALES * scale))
        if blob is None:
            return None, flow_s
        (column, row), mask = blob
        position = np.array([column, row]) * cell + cell // 2
        return (position, np.median(flow[mask], axis=0)), flow_s

    def basis_on(self, rows, columns):
        """One row per equation of a flow vector's u, then v, one column per coefficient."""
        y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
        x, y = 2 * x / columns - 1, 2 * y / rows - 1
        one, zero = np.ones_like(x), np.zeros_like(x)
        u, v = [one, x, y, zero, zero, zero], [zero, zero, zero, one, x, y]
        if self.quadratic:
            u, v = u + [x * x, x * y], v + [x * y, y * y]
        return np.stack([np.stack(u, -1), np.stack(v, -1)], 2)

    def entered(self, background, shape):
        """Which cells show what was not in the older frame, or hardly."""
        rows, columns = background.shape[:2]
        middle = self.CELL // 2
        x = np.arange(columns) * self.CELL + middle - background[..., 0]
        y = (np.arange(rows) * self.CELL + middle)[:, None] - background[..., 1]
        outside = [
            (place < self.MARGIN * side) | (place > (1 - self.MARGIN) * side - 1)
            for place, side in ((x, shape[1]), (y, shape[0]))
        ]
        return outside[0] | outside[1]

    def dominant_motion(self, flow):
        """The background's flow, and by how much the flow scatters about it, px."""
        every = self.FIT_EVERY
        basis = self.basis[::every, ::every].reshape(-1, 2, self.basis.shape[-1])
        wanted = flow[::every, ::every].reshape(-1, 2)
        left = wanted - np.median(wanted, axis=0)
        for _ in range(self.STEPS):
            length = np.hypot(left[:, 0], left[:, 1])
            scale = max(1.4826 * float(np.median(length)), 0.05)
            weight = 1 / (1 + (length / (2 * scale)) ** 2) ** 2
            weighted = (basis * weight[:, None, None]).reshape(-1, basis.shape[-1])
            plain = basis.reshape(-1, basis.shape[-1])
            normal = weighted.T @ plain + 1e-6 * np.eye(basis.shape[-1])
            coefficients = np.linalg.solve(normal, weighted.T @ wanted.reshape(-1))
            left = wanted - basis @ coefficients.astype(np.float32)
        return self.basis @ coefficients.astype(np.float32), scale


class Difference:
    """Tracked corners, homography, what differs after it."""

    CORNERS = 400
    REPROJECTION_PX = 1.5
    SCALES = 6.0
    LEAST_GREY = 1.5

    def step(self, older, newer):
        """Position and velocity of what moves, or None, and the seconds that corners and tracking took."""
        start = time.perf_counter()
        tracks = self.track(older, newer)
        track_s = time.perf_counter() - start
        if tracks is None:
            return None, track_s
        old, new = tracks
        homography, _ = cv2.findHomography(old, new, cv2.RANSAC, self.REPROJECTION_PX)
        if homography is None:
            return None, track_s
        rows, columns = newer.shape
        size = (columns, rows)
        warped = cv2.warpPerspective(older, homography, size)
        inside = cv2.warpPerspective(np.full_like(older, 255), homography, size, flags=cv2.INTER_NEAREST)
        inside = cv2.erode(inside, np.ones((9, 9), np.uint8), borderValue=0)
        difference = cv2.absdiff(newer, warped)
        difference[inside == 0] = 0
        difference = cv2.resize(difference, (columns // 2, rows // 2), interpolation=cv2.INTER_AREA)
        difference = cv2.GaussianBlur(difference.astype(np.float32), (0, 0), 0.5 + columns / 256)
        middle = float(np.median(difference))
        spread = 1.4826 * float(np.median(np.abs(difference - middle)))
        blob = largest_blob(difference, middle + self.SCALES * spread + self.LEAST_GREY)
        if blob is None:
            return None, track_s
        (column, row), mask = blob
        cells = np.clip((new // 2).astype(int), 0, [mask.shape[1] - 1, mask.shape[0] - 1])
        moved = (new - old)[mask[cells[:, 1], cells[:, 0]]]
        velocity = np.median(moved, axis=0) if len(moved) else None
        return (np.array([column, row]) * 2 + 0.5, velocity), track_s

    def track(self, older, newer):
        """Corners of the older frame and where they are in the newer one."""
        corners = cv2.goodFeaturesToTrack(older, self.CORNERS, 0.01, 8)
        if corners is None or len(corners) < 8:
            return None
        found, status, _ = cv2.calcOpticalFlowPyrLK(older, newer, corners, None, winSize=(15, 15), maxLevel=3)
        good = status.reshape(-1) == 1
        if good.sum() < 8:
            return None
        return corners.reshape(-1, 2)[good], found.reshape(-1, 2)[good]


def largest_blob(score, threshold):
    """Weighted centroid (column, row) and mask of the component above the threshold with the largest sum."""
    mask = (score > threshold).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    best = None
    for label in range(1, count):
        left, top, width, height, area = stats[label]
        if not LEAST_SHARE * score.size <= area <= MOST_SHARE * score.size:
            continue
        box = np.s_[top : top + height, left : left + width]
        total = float(score[box][labels[box] == label].sum())
        if best is None or total > best[0]:
            best = (total, label)
    if best is None:
        return None
    mask = labels == best[1]
    rows, columns = np.nonzero(mask)
    weights = score[mask]
    return (np.average(columns, weights=weights), np.average(rows, weights=weights)), mask


class Tally:
    """Verdicts on many pairs, and the time they took."""

    def __init__(self):
        self.hits = self.wrong = self.missed = self.false_alarms = self.quiet = 0
        self.errors, self.velocity_errors, self.flow_s, self.whole_s = [], [], [], []

    def add(self, other):
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def judge(self, truth, answer, size):
        position, speed = truth["position"], float(np.hypot(*truth["relative_velocity"]))
        hidden = position is None and truth["area_px"] < LEAST_AREA_PX
        resting = position is not None and speed < RESTING_PX
        if hidden or resting:
            self.quiet += answer is None
            if answer is not None:
                # To know still where a resting or hidden target is, is neither right nor wrong.
                centre = truth["centre"]
                known = centre is not None and np.hypot(*(answer[0] - centre)) <= SHARE_KNOWN * size
                self.false_alarms += not known
            return
        inside = position is not None and all(BORDER * size < p < (1 - BORDER) * size for p in position)
        if not inside or speed <= MOVING_PX:
            return
        if answer is None:
            self.missed += 1
            return
        error = float(np.hypot(*(answer[0] - position)))
        if error > SHARE_OF_SIZE * truth["area_px"] ** 0.5 + SHARE_OF_SIDE * size:
            self.wrong += 1
            return
        self.hits += 1
        self.errors.append(error)
        if answer[1] is not None:
            self.velocity_errors.append(float(np.hypot(*(answer[1] - truth["velocity"]))))

    def figures(self):
        moving, empty = self.hits + self.wrong + self.missed, self.false_alarms + self.quiet
        median = lambda values: float(np.median(values)) if values else None
        share = lambda part, whole: part / whole if whole else None
        return {
            "pairs": moving + empty,
            "detected": share(self.hits, moving),
            "wrong": share(self.wrong, moving),
            "false_alarms": share(self.false_alarms, empty),
            "error_px": median(self.errors),
            "velocity_error_px": median(self.velocity_errors),
            "us_flow": median([1e6 * s for s in self.flow_s]),
            "us_per_frame": median([1e6 * s for s in self.whole_s]),
        }


def rivals():
    return {"DIS affine": Flow(False), "DIS quadratic": Flow(True), "LK difference": Difference()}


def watch(folder, sheet):
    """What each rival does on the sequence of this folder."""
    frames = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in sorted(folder.glob("f*.png"))]
    if len(frames) < len(sheet["frames"]) or any(frame is None for frame in frames):
        sys.exit(f"ops/rivals.py: {folder}: a frame is missing or broken")
    tallies = {}
    for name, rival in rivals().items():
        tally = tallies[name] = Tally()
        for truth, older, newer in zip(sheet["frames"][1:], frames, frames[1:]):
            start = time.perf_counter()
            answer, flow_s = rival.step(older, newer)
            tally.whole_s.append(time.perf_counter() - start)
            tally.flow_s.append(flow_s)
            tally.judge(truth, answer, sheet["size"])
    return tallies


def measure(folder):
    """Per sequence (group, name, size, figures per rival), and the totals (size, rival) without the hard ones."""
    scenes, totals = [], {}
    for file in sorted(folder.glob("*/truth.json")):
        sheet = json.loads(file.read_text())
        tallies = watch(file.parent, sheet)
        figures = {name: tally.figures() for name, tally in tallies.items()}
        scenes.append((sheet["group"], sheet["name"], sheet["size"], figures))
        for name, tally in tallies.items():
            if sheet["group"] != "hard":
                totals.setdefault((sheet["size"], name), Tally()).add(tally)
    if not scenes:
        sys.exit(f"ops/rivals.py: {folder} holds no sequence: pursuit experiment robustness --frames {folder}")
    return scenes, {key: tally.figures() for key, tally in totals.items()}


def join(scenes, totals, file):
    """Adds pursuit's own figures, from the file that its option --json has written; its number of seeds."""
    results = json.loads(file.read_text())
    for _, name, size, figures in scenes:
        for scene in results["scenes"]:
            if (scene["name"], scene["size"]) == (name, size):
                figures[scene["mode"]] = scene
    for mode, total in results["total"].items():
        for size, figures in total["sizes"].items():
            totals[int(size), mode] = figures
    return results["seeds"]


def text(value, factor=1.0, digits=1):
    return "-" if value is None else f"{factor * value:.{digits}f}"


def print_scenes(scenes, size):
    for group in ("with_target", "hard", "without_target"):
        rows = [(name, figures) for g, name, s, figures in scenes if (g, s) == (group, size)]
        if not rows:
            continue
        names = list(rows[0][1])
        what = "false alarms %" if group == "without_target" else "found % / median error px"
        print(f"\n{size} px, {group.replace('_', ' ')}: {what}")
        print(f"{'':22}" + "".join(f"{name:>16}" for name in names))
        for scene, figures in rows:
            cells = []
            for name in names:
                one = figures.get(name, {})
                if group == "without_target":
                    cells.append(text(one.get("false_alarms"), 100, 0))
                else:
                    cells.append(f"{text(one.get('detected'), 100, 0)} / {text(one.get('error_px'))}")
            print(f"{scene:22}" + "".join(f"{cell:>16}" for cell in cells))


def print_totals(totals):
    print("\nall but the hard ones; time per frame in ms: flow or tracking alone, the whole step")
    heads = ["found %", "wrong %", "alarms %", "px", "px/frame", "flow ms", "whole ms"]
    print(f"{'':16}{'px':>5}" + "".join(f"{head:>10}" for head in heads))
    for (size, name), f in sorted(totals.items(), key=lambda item: -item[0][0]):
        shares = [text(f[key], 100) for key in ("detected", "wrong", "false_alarms")]
        errors = [text(f[key], 1, 2) for key in ("error_px", "velocity_error_px")]
        times = [text(f.get(key), 1e-3, 2) for key in ("us_flow", "us_per_frame")]
        print(f"{name:16}{size:>5}" + "".join(f"{cell:>10}" for cell in shares + errors + times))


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("frames", type=Path, metavar="DIR", help="what --frames DIR has written")
    parser.add_argument("--pursuit", type=Path, metavar="FILE", help="what --json FILE has written")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rivals' figures there")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    cv2.setRNGSeed(1)
    scenes, totals = measure(options.frames)
    if options.json:
        listed = [
            {"name": name, "group": group, "size": size, "mode": mode, **figures}
            for group, name, size, of_scene in scenes
            for mode, figures in of_scene.items()
        ]
        listed_totals = [{"size": size, "mode": mode, **f} for (size, mode), f in totals.items()]
        options.json.write_text(json.dumps({"scenes": listed, "total": listed_totals}, indent=2) + "\n")
    seeds = join(scenes, totals, options.pursuit) if options.pursuit else 1
    for size in sorted({size for _, _, size, _ in scenes}, reverse=True):
        print_scenes(scenes, size)
    print_totals(totals)
    if seeds > 1:
        print(f"\npursuit's figures are over {seeds} seeds, the rivals' over the first of them")
    print(f"\nOpenCV {cv2.__version__}; another program on the machine distorts the times")


if __name__ == "__main__":
    main()
