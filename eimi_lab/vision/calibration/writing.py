"""Write a calibration file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.toml import parse
from eimi_lab.process.outputs import write_file


def write_calibration(calibration: Calibration, path: Path, force: bool) -> None:
    """Write a calibration file (calibration.toml).

    Parameters
    ----------
    calibration : Calibration
        The calibration.
    path : Path
        The file to write.
    force : bool
        Whether an existing file is overwritten.

    Raises
    ------
    InputError
        If the file exists and `force` is false, or if it cannot be written.
    """
    uncertain = calibration.uncertainty
    lines = [
        f"pixels_per_mm = {calibration.pixels_per_mm:.6f}",
        f"clamp_midpoint_px = {_listed(calibration.clamp_midpoint_px)}",
        f"axis_angle_deg = {calibration.axis_angle_deg:.5f}       # clockwise from the image's +x, like all angles",
        f"gravity_angle_deg = {calibration.gravity_angle_deg:.5f}",
    ]
    if calibration.coil_constant_mT_per_A is not None:
        lines.append(f"coil_constant_mT_per_A = {calibration.coil_constant_mT_per_A!r}")
        lines.append(f"field_angle_deg = {calibration.positive_field_deg:.5f}")
    if not calibration.gravity:
        lines.append("gravity = false")
    if calibration.camera_matrix is not None and calibration.distortion is not None:
        lines.append("camera_matrix = [" + ", ".join(map(_listed, calibration.camera_matrix)) + "]")
        lines.append(f"distortion = {_listed(calibration.distortion)}")
    if calibration.stand_off_mm is not None:
        lines.append(f"stand_off_mm = {calibration.stand_off_mm:.3f}")
    if calibration.telecentric:
        lines.append("telecentric = true")
    if calibration.calibrated_on is not None:
        lines.append(f"calibrated_on = {calibration.calibrated_on.isoformat()}")
    if uncertain is not None:
        lines += ["", "[uncertainty]    # standard uncertainties of the numbers above; add all others that you know"]
        lines += [f"{name} = {value:.3g}" for name, value in uncertain.items()]
    text = "\n".join(lines) + "\n"
    parse(Calibration, text, path)
    write_file(path, text, force)


def _listed(numbers: Sequence[float]) -> str:
    return "[" + ", ".join(f"{number:.8g}" if number % 1 else f"{number:.1f}" for number in numbers) + "]"
