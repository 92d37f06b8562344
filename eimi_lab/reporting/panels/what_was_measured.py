"""List the facts of a dataset: specimen, date, rig, protocol, camera, gravity and load steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from eimi_lab.config.toml import parse_table
from eimi_lab.dataset.moving.recording_checks import recordings_in_words
from eimi_lab.fits.measured_record import MeasuredField, MeasuredTemperature
from eimi_lab.reporting.contents import DatasetContents
from eimi_lab.reporting.panel import DatasetPanel

Facts = list[tuple[str, str]]


def facts(contents: DatasetContents) -> Facts:
    """Return the names and values of the facts about a dataset."""
    dataset = contents.dataset
    start = dataset.start_time()
    gravity = (
        _gravity_words(dataset.gravity_angle_deg) if dataset.gravity else "none: the weight does not bend the beam"
    )
    states = contents.evidence.used.in_words() + ("" if dataset.finished else "; the run is not finished")
    rows = [*_of_specimen(contents), ("measured on", f"{start.day} {start:%B %Y, %H:%M %Z}")]
    rows += _of_rig(contents) + _of_protocol(contents) + _of_picture(contents)
    rows += [("gravity", gravity), ("states", states)]
    rows += _measured(contents)
    motions = (*dataset.ring_downs(), *dataset.creeps())
    rows += [("ring-downs and creep", recordings_in_words(motions))] if motions else []
    note = dataset.text("user_note")
    rows += [("operator's note", note)] if note else []
    rows += [("corrected", words) for words in dataset.corrections()]
    if dataset.truth() is not None:
        rows.append(("origin", "simulated on the virtual rig"))
    if contents.validations and not any(v.seen for v in contents.validations):
        rows.append(("unseen", "no law was fitted to this dataset; its errors are errors of predictions"))
    return [*rows, ("content", f"sha256 {contents.evidence.sha256}")]


def _measured(contents: DatasetContents) -> Facts:
    """Return the facts that sensors measured: field, temperature of the specimen, and temperature of the coil."""
    evidence = contents.evidence
    field, specimen = MeasuredField.of(evidence), MeasuredTemperature.of(evidence)
    rows = [("measured field", field.in_words)] if field else []
    rows += [("temperature of the specimen", specimen.in_words)] if specimen else []
    return rows + ([("temperature of the coil", evidence.heating.in_words)] if evidence.heating else [])


def _of_specimen(contents: DatasetContents) -> Facts:
    file = contents.dataset.specimen
    beam, magnet = file.specimen, file.magnet
    uncertain = _uncertain(file.uncertainty)
    sizes = " × ".join(f"{getattr(beam, key):g}{uncertain(key)}" for key in ("length_mm", "width_mm", "depth_mm"))
    section = " and ".join(dict.fromkeys(v.section for v in contents.validations))
    rows = [
        ("specimen", f"{beam.name}, {beam.material}"),
        (
            "length × width × depth",
            (
                f"{sizes} mm, model of the cross-section: "
                f"{section or contents.evidence.experiment.model.specimen.section}"
            ),
        ),
        ("density", f"{beam.density_kg_m3:g}{uncertain('density_kg_m3')} kg/m³"),
    ]
    if magnet is None:
        return [*rows, ("magnet", "none")]
    keys = ("length_mm", "width_mm", "depth_mm")
    sizes = " × ".join(f"{getattr(magnet, key):g}{uncertain(f'magnet_{key}')}" for key in keys)
    words = f"{sizes} mm, {magnet.remanence_T:g}{uncertain('remanence_T')} T, {magnet.density_kg_m3:g} kg/m³"
    return [*rows, ("magnet", words)]


def _of_rig(contents: DatasetContents) -> Facts:
    text = contents.dataset.text("rig")
    if text is None:
        return [("rig", "unknown, because the data were imported")]
    name = parse_table(text, "rig").get("name", "")
    return [("rig", str(name)), *(("instrument", line) for line in contents.dataset.instruments())]


def _of_protocol(contents: DatasetContents) -> Facts:
    text = contents.dataset.text("protocol")
    if text is None:
        return []
    table = parse_table(text, "protocol")
    frames = table.get("frames_per_state")
    currents = [s.current_A for s in contents.dataset.states if s.current_A is not None]
    words = (
        f"{table.get('name', '')}: {len(currents)} states from {min(currents):g} to {max(currents):g} A"
        if currents
        else str(table.get("name", ""))
    )
    return [("protocol", f"{words}, {frames} frames each" if frames else words)]


def _of_picture(contents: DatasetContents) -> Facts:
    calibration = contents.dataset.calibration
    fields = [s.field_mT for s in contents.dataset.states]
    span = f"fields from {min(fields):.4g} to {max(fields):.4g} mT" if fields else ""
    if calibration is None:
        return [("loads", span)] if any(fields) else []
    uncertain = _uncertain(calibration.uncertainty)
    scale = f"{calibration.pixels_per_mm:g}{uncertain('pixels_per_mm')} pixels/mm"
    scale += f"; one pixel is {1e3 / calibration.pixels_per_mm:.4g} µm"
    lens = (
        "telecentric"
        if calibration.telecentric
        else f"{calibration.stand_off_mm:g} mm away"
        if calibration.stand_off_mm
        else "stand-off not stated"
    )
    day = f", calibrated on {calibration.calibrated_on}" if calibration.calibrated_on else ""
    if calibration.coil_constant_mT_per_A is None:
        return [("scale", f"{scale}{day}"), ("lens", lens), ("coil", "none")]
    coil = f"{calibration.mT_per_A:g}{uncertain('coil_constant_mT_per_A')} mT/A; {span}"
    return [("scale", f"{scale}{day}"), ("lens", lens), ("coil constant", coil)]


def _uncertain(stated: Mapping[str, Any] | None) -> Callable[[str], str]:
    """Return a function that returns the uncertainty of a quantity as text, such as ` ± 0.02`.

    The argument of the function is the key of the quantity. `stated` is the table [uncertainty] of an input file.
    """

    def words(key: str) -> str:
        value = (stated or {}).get(key)
        return " (± not stated)" if value is None else f" ± {value:g}" if value else ""

    return words


def _gravity_words(degrees: float) -> str:
    angle = math.remainder(degrees, 360.0)
    return "along the beam at rest (the beam hangs)" if abs(angle) < 0.5 else f"at {angle:.4g}° to the beam at rest"


def _values(contents: DatasetContents) -> dict[str, Any]:
    return {"facts": facts(contents)}


PANEL = DatasetPanel(
    place=0,
    title="",
    template="""
<dl class="facts">
{% for name, words in facts %}<dt>{{ name }}</dt><dd>{{ words }}</dd>
{% endfor %}
</dl>
""",
    values=_values,
)
