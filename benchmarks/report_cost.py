"""Measure the time and memory of `eimi report` for three simulated datasets with twenty fits each.

``--curve FILE`` gives a tensile test; by default the tensile test is simulated.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.fit_cost import spent
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress

SPECIMENS = ("type1", "type2", "type3")
_YEOH_PA = (20e3, 3e3, 50.0)
_LARGEST_STRAIN, _ROWS = 4.0, 200


def curve(path: Path) -> Path:
    """Write a simulated tensile test with two columns (strain, stress in kPa); return the path."""
    strain = np.linspace(0.0, _LARGEST_STRAIN, _ROWS + 1)[1:]
    stress_kPa = 1e-3 * engineering_stress(LAWS["yeoh"], np.array([_YEOH_PA]), strain)[0]
    rows = [f"{e:.4f},{s:.5f}" for e, s in zip(strain, stress_kPa, strict=True)]
    path.write_text("\n".join(["strain,stress_kPa", *rows]) + "\n")
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--curve", type=Path, help="file with a tensile test")
    parser.add_argument("--repeats", type=int, default=3, help="number of runs; the fastest counts")
    options = parser.parse_args()
    laws = [word for law in LAWS for word in ("--model", law)]
    with tempfile.TemporaryDirectory(prefix="report_cost") as name:
        folder = Path(name)
        datasets = [str(folder / f"{specimen}.h5") for specimen in SPECIMENS]
        for specimen, path in zip(SPECIMENS, datasets, strict=True):
            spent("acquire", "dragon_skin_10", "--specimen", specimen, "--rig", "virtual", "-o", path)
        bending, tensile, page = (str(folder / file) for file in ("fits.json", "tensile.json", "report.html"))
        spent("fit", datasets[0], *laws, "-o", bending)
        spent("tensile", str(options.curve or curve(folder / "curve.csv")), *laws, "-o", tensile)
        print("| datasets | fits | processor, s | MB | wall-clock, default workers, s |")
        print("| --- | --- | --- | --- | --- |")
        for paths, fits in ((datasets[:1], [bending]), (datasets, [bending]), (datasets, [bending, tensile])):
            shown = [word for path in fits for word in ("--fit", path)]
            report = ("report", *paths, *shown, "-o", page, "--force")
            seconds, megabytes = zip(*(spent(*report, "--workers", "1") for _ in range(options.repeats)), strict=True)
            start_s = time.perf_counter()
            spent(*report)
            clock = time.perf_counter() - start_s
            count = {1: len(LAWS), 2: 5 * len(LAWS)}[len(fits)]
            print(f"| {len(paths)} | {count} | {min(seconds):.1f} | {max(megabytes):.0f} | {clock:.1f} |", flush=True)


if __name__ == "__main__":
    main()
