"""Measure the error of the detected edges in rendered pictures of circular arcs: ``python -m benchmarks.edges``."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2

from tests.shared.edge_methods import METHODS
from tests.shared.rendered_edges import (
    BESIDE,
    CALIBRATION,
    CONDITIONS,
    NOMINAL,
    SPECIMEN,
    measure,
    measure_other,
    overall,
    with_silicone_beside,
)

SWEEP = {
    "blur 0.5 px": replace(NOMINAL, blur_px=0.5),
    "blur 2 px": replace(NOMINAL, blur_px=2.0),
    "blur 4 px": replace(NOMINAL, blur_px=4.0),
    "2500 electrons": replace(NOMINAL, full_well_e=2500.0),
    "1000 electrons": replace(NOMINAL, full_well_e=1000.0),
    "12 bit, 30 000 electrons": replace(NOMINAL, full_well_e=30_000.0, bits=12),
    "gradient 40 %": replace(NOMINAL, gradient=0.4),
    "lumps 10 %": replace(NOMINAL, lumps=0.1),
    "silicone transmits 0 %": replace(NOMINAL, silicone_transmission=0.0, magnet_transmission=0.0),
    "silicone transmits 30 %": replace(NOMINAL, silicone_transmission=0.3),
    "silicone 30 %, magnet 30 %": replace(NOMINAL, silicone_transmission=0.3, magnet_transmission=0.3),
    "clipped back-light": replace(NOMINAL, background=1.2),
    "gamma 2.2": replace(NOMINAL, gamma=2.2),
}
EXPLANATION = """\
error along the normal, outward positive, px; pull: RMS of error over stated standard deviation; "of one angle": range
of the pulls of single tip angles; hard: a difficult picture (blurred, noisy, uneven light); lumps: uneven light in
patches; "n px": width of the silicone on each side of the magnet, and "it" is this width; Devernay: points of largest
gradient, located between pixels (INRIA RR-2724, 1995)"""
ANGLES_DEG = (-110.0, -75.0, -40.0, -10.0, 0.0, 3.0, 20.0, 55.0, 90.0, 110.0)
FEW_ANGLES_DEG = (-75.0, 0.0, 3.0, 40.0)


def _print_overall(name: str, rows: list[dict[str, Any]]) -> None:
    row = overall(rows)
    pulls = f"{row['pull']:.2f} | {row['least_pull']:.2f} to {row['largest_pull']:.2f}"
    print(f"| {name} | {_four(row)} | {row['worst']:.3f} | {pulls} | {row['ms']:.0f} |", flush=True)


def main() -> None:
    cv2.setNumThreads(1)
    print(EXPLANATION)
    print("\n| condition | bias left | right | RMS left | right | largest | pull | of one angle | ms |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, optics in (CONDITIONS | SWEEP).items():
        _print_overall(name, measure(optics, ANGLES_DEG, frames=4, seed=1))
    assert SPECIMEN.magnet is not None
    long_mm = SPECIMEN.magnet.length_mm
    for name, (optics, wide_px, share) in BESIDE.items():
        off_mm = share * wide_px / CALIBRATION.pixels_per_mm
        _print_overall(name, measure(optics, ANGLES_DEG, 4, 1, with_silicone_beside(wide_px), off_mm, long_mm))
    print("\n| nominal, tip angle | bias left | right | RMS left | right | largest | pull | ms |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for row in measure(NOMINAL, ANGLES_DEG, frames=4, seed=1):
        print(f"| {row['angle']:.0f}° | {_four(row)} | {row['worst']:.3f} | {row['pull']:.2f} | {row['ms']:.0f} |")
    print("\n| method | condition | bias left | right | RMS left | right | ms |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for title, method in METHODS.items():
        for name, optics in CONDITIONS.items():
            row = measure_other(method, optics, FEW_ANGLES_DEG, seed=1)
            print(f"| {title} | {name} | {_four(row)} | {row['ms']:.0f} |", flush=True)


def _four(row: dict[str, Any]) -> str:
    biases = f"{row['left_bias']:+.4f} | {row['right_bias']:+.4f}"
    return f"{biases} | {row['left_rms']:.4f} | {row['right_rms']:.4f}"


if __name__ == "__main__":
    main()
