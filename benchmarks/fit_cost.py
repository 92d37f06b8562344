"""Measure time and memory of `eimi fit` for simulated measurements, and their growth with the number of load steps.

The script also prints the size of the data that a worker process receives.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.timing import fastest
from eimi_drivers.interfaces import Frame
from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.inference.evidence.measurements import PointObservation
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.laws import LAWS
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.process.threads import THREADS
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet

MODULUS_PA, LARGEST_A, NOISE_MM = 46e3, 1.5, 2e-3
SECTIONS = ("plane-stress", "solid")
STATES = (16, 126, 501)
# A small process starts `eimi fit`, because the reported memory of a child process includes the memory of its parent.
_STARTED = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss)
"""
POINTS, POINT_STATES = 60, (16, 64, 256)


def dataset(path: Path, states: int) -> Path:
    """Write a dataset with edges in `states` load steps; return its path."""
    specimen, calibration = load_specimen("type1"), load_rig("virtual").calibration
    frame = BeamFrame(calibration)
    current_A = np.linspace(0.0, LARGEST_A, states)
    field_mT = calibration.coil_constant_mT_per_A * current_A
    loads = Loads.along(field_mT, field_angle_deg=frame.field_deg, gravity_angle_deg=frame.gravity_deg)
    model = SolidBeside(replace(specimen.mechanics(), section="solid"), 26, 3)
    curves = outline(model, model.solve(LAWS["neo-hookean"], np.array([[MODULUS_PA]]), loads))[0]
    edges = points_on(curves, 4)[:, :, 4:-4]
    edges = edges + np.random.default_rng(0).normal(0.0, NOISE_MM, edges.shape)
    sigma, corners = np.full(edges.shape[2], 1.5 * NOISE_MM), np.full((4, 2), np.nan)
    edge_sets = [
        EdgeSet(*(EdgePoints(side, sigma) for side in sides), (), corners, calibration.digest) for sides in edges
    ]
    pixels = np.zeros((16, 16), np.uint8)
    with DatasetWriter(path, Header(specimen, calibration), Frame(pixels, 0, 0.0)) as writer:
        for k in range(states):
            frames = [Frame(pixels, k, float(k))]
            writer.append_state(frames, current_A=float(current_A[k]), field_mT=float(field_mT[k]))
    write_edges(path, edge_sets)
    return path


def spent(*arguments: str) -> tuple[float, float]:
    """Run `eimi` in a separate process; return the processor time (s) and the largest memory (MB)."""
    command = [sys.executable, "-c", _STARTED, sys.executable, "-m", "eimi_lab", *arguments]
    alone = os.environ | dict.fromkeys(THREADS, "1")
    run = subprocess.run(command, env=alone, capture_output=True, text=True, check=True)
    seconds, largest = map(float, run.stdout.split())
    return seconds, largest / (1 << 20 if sys.platform == "darwin" else 1 << 10)


def fit_cost(path: Path, section: str, laws: tuple[str, ...], repeats: int = 1) -> tuple[float, float]:
    """Return the shortest processor time (s) and the largest memory (MB) of several runs of `eimi fit`.

    `section` is the kind of beam model, such as "plane-stress" or "solid".
    """
    models = [word for law in laws for word in ("--model", law)]
    fit = ("fit", str(path), "--force", "--section", section, "-o", str(path.with_suffix(".json")), *models)
    seconds, largest = zip(*(spent(*fit) for _ in range(repeats)), strict=True)
    return min(seconds), max(largest)


def task_kB(path: Path, section: str) -> float:
    """Return how much data (kB) a worker process receives for one fit."""
    evidence = load_evidence(path, section=section)
    task = {"model": "ogden", "experiments": [evidence.experiment], "seed": 1}
    return len(pickle.dumps((identify, task))) / 1e3


def points_ms(states: int) -> float:
    """Return the time (ms) to compare eight simulated beams with measured points in `states` load steps."""
    model = BeamModel(replace(load_specimen("type1").mechanics(), section="plane-stress"))
    ends = (1.0, model.specimen.length_mm - 1.0)
    rest = np.column_stack([np.linspace(*ends, POINTS), np.zeros(POINTS)])
    loads = Loads.along(np.linspace(0.0, 7.0, states))
    shapes = model.solve(LAWS["neo-hookean"], np.full((8, 1), MODULUS_PA), loads, tolerance_mm=1e-2)
    moved = model.positions(shapes, rest)[0]
    observed = PointObservation(np.tile(rest, (states, 1, 1)), moved, np.full((states, POINTS), 0.01))
    return 1e3 * fastest(lambda: observed.misfit(model, shapes), 5)[0]


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="fit_cost") as folder:
        paths = {states: dataset(Path(folder) / f"{states}.h5", states) for states in STATES}
        few = paths[STATES[0]]
        print(f"\n| `eimi fit`, {STATES[0]} states, s | {' | '.join(LAWS)} | all four |")
        print("| --- " * (len(LAWS) + 2) + "|")
        for section in SECTIONS:
            costs = [fit_cost(few, section, laws, 3)[0] for laws in (*((law,) for law in LAWS), tuple(LAWS))]
            print(f"| {section} | " + " | ".join(f"{seconds:.1f}" for seconds in costs) + " |", flush=True)
        print("\n| states | " + " | ".join(f"{section}, s | MB" for section in SECTIONS) + " | sent to a worker, kB |")
        print("| --- " * (2 * len(SECTIONS) + 2) + "|")
        for states, path in paths.items():
            costs = [
                f"{s:.1f} | {mb:.0f}" for s, mb in (fit_cost(path, section, ("neo-hookean",)) for section in SECTIONS)
            ]
            print(f"| {states} | {' | '.join(costs)} | {task_kB(path, 'solid'):.0f} |", flush=True)
    tracked = [(states, points_ms(states)) for states in POINT_STATES]
    exponent = np.polyfit(*np.log(np.array(tracked)).T, 1)[0]
    print(
        f"\nms to compare eight candidates with {POINTS} tracked points, by number of states (slope {exponent:.2f}): ",
        end="",
    )
    print(", ".join(f"{states}: {ms:.1f}" for states, ms in tracked))


if __name__ == "__main__":
    main()
