"""Show a viscoelastic (Prony) law with its data: ring-downs (free vibrations) and creep."""

from __future__ import annotations

from typing import Any

import numpy as np

from eimi_fitting.time.result import LawOfTime
from eimi_lab.fits.time_records import time_lines
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Picture, Table
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.showing.drawing import Drawing
from eimi_lab.showing.significant import significant

_HEAD = ("ring-down", "from", "to", "amplitude", "frequency", "loss factor", "used")
_CAPTION = (
    "Viscoelastic (Prony) law. Top left: displacement of the point that moves most, and the fitted envelope. "
    "Top right: change of the frequency from its value at small amplitude (solid), and loss factor of the decay "
    "(dashed). Bottom left: shear modulus against the time after a sudden strain, with its 95 % band. In the grey "
    "range the data determine the modulus to 5 %. Bottom right: rotation of the tip in creep, measured and fitted."
)
_WINDOWS = "Time windows of each ring-down. The fit uses only amplitudes below 5 % of the length of the beam."


def _picture(time: LawOfTime, label: str) -> Picture:
    figure = Drawing(9.0, 6.2)
    decay, amplitude, modulus, creep = figure.subplots(2, 2).ravel()
    for ring in time.ring_downs[:1]:
        decay.plot(ring.time_s, ring.displacement_mm, ".", markersize=2, label="measured")
        decay.plot(ring.time_s, ring.envelope_mm, color="#333333", linewidth=1, label="envelope")
        decay.plot(ring.time_s, -np.array(ring.envelope_mm), color="#333333", linewidth=1)
    decay.set_xlabel("time, s")
    decay.set_ylabel("displacement, mm")
    decay.legend(fontsize=7)
    right = amplitude.twinx()
    for ring in time.ring_downs:
        sizes = [window.amplitude_mm for window in ring.windows]
        changes = [100 * (window.frequency_Hz / ring.frequency_Hz - 1) for window in ring.windows]
        amplitude.plot(sizes, changes, "o-", markersize=3, linewidth=0.8)
        right.plot(sizes, [window.loss for window in ring.windows], "s--", markersize=3, linewidth=0.8)
    amplitude.set_xscale("log")
    amplitude.set_xlabel("amplitude, mm")
    amplitude.set_ylabel("change of frequency, % (solid)")
    right.set_ylabel("loss factor of the decay (dashed)")
    times = [point.time_s for point in time.modulus_by_time]
    low, high = np.array([point.interval_95 for point in time.modulus_by_time]).T
    modulus.fill_between(times, 1e-3 * low, 1e-3 * high, alpha=0.3)
    modulus.plot(times, [1e-3 * point.value for point in time.modulus_by_time])
    if time.known_between_s:
        modulus.axvspan(*time.known_between_s, color="#999999", alpha=0.15)
    modulus.set_xscale("log")
    modulus.set_xlabel("time after a sudden strain, s")
    modulus.set_ylabel("shear modulus, kPa")
    for curve in time.creep:
        (line,) = creep.plot(curve.time_s, curve.fitted_deg, linewidth=0.8)
        creep.plot(curve.time_s, curve.measured_deg, "o", markersize=3, color=line.get_color(), label=curve.label)
    creep.set_xscale("log")
    creep.set_xlabel("time after the step, s")
    creep.set_ylabel("rotation of the tip from its mean, degrees")
    if time.creep:
        creep.legend(fontsize=7)
    else:
        creep.text(0.5, 0.5, "no creep was recorded", transform=creep.transAxes, ha="center")
    return Picture(
        "law_of_time",
        figure,
        "four plots: ring-down, frequency and loss factor against amplitude, shear modulus against time, creep",
        f"{label}. {_CAPTION}",
    )


def _values(report: ReportContents) -> dict[str, Any] | None:
    if not report.laws_of_time:
        return None
    label, time = report.laws_of_time[0]
    rows = [
        (
            ring.label,
            f"{significant(window.from_s, 3)} s",
            f"{significant(window.to_s, 3)} s",
            f"{significant(window.amplitude_mm, 3)} mm",
            f"{window.frequency_Hz:.4f} ± {window.frequency_sigma_Hz:.1g} Hz",
            f"{window.loss:.4f} ± {window.loss_sigma:.1g}",
            "yes" if window.is_used else "no",
        )
        for ring in time.ring_downs
        for window in ring.windows
    ]
    return {
        "picture": _picture(time, label),
        "windows": Table("ring_down_windows", _WINDOWS, _HEAD, rows, time_lines(time)),
    }


PANEL = ReportPanel(
    place=9,
    title="Viscoelastic law",
    template="{{ picture | figure }}{{ windows | table }}",
    values=_values,
    of_fits=True,
)
