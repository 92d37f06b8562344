"""Correct the specimen or the calibration of a finished dataset, keep the replaced texts, and remove the edges.

Motions (positions of points over time) are removed with the edges, because both depend on the calibration.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import h5py

from eimi_lab.config.calibration import Calibration, Changes, changed_calibration, load_calibration, missing_places
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import Document, differences
from eimi_lab.dataset.containment import FORMER
from eimi_lab.dataset.layout import group, note, now, put_text
from eimi_lab.dataset.moving.recorded_motion import recorded_kinds
from eimi_lab.dataset.moving.stored_motions import drop_motions
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.dataset.rewriting import rewritten
from eimi_lab.dataset.stored_edges import drop_edges
from eimi_lab.process.errors import InputError, tell
from eimi_lab.vision.clicked_points import check_clicked_points
from eimi_lab.vision.edges.region import region_of

_LARGEST_TEXTS_BYTES = 1 << 16


def restate(
    path: Path, *, specimen: str | None = None, calibration: Path | None = None, changes: Changes | None = None
) -> tuple[str, ...]:
    """Replace the specimen or the calibration in a dataset of frames, and return a line of text for each changed key.

    A change removes the edges and the motions, with a note for imported motions. The fields of a run are computed again
    from its currents.

    Parameters
    ----------
    path
        The dataset.
    specimen, calibration
        The new files; None to keep the stored text. A new calibration may leave out position and direction of the beam.
    changes
        New values for keys of the calibration, with priority over the file ``calibration``.

    Raises
    ------
    InputError
        If the dataset holds tracked points, or if the new files do not suit the dataset.
    """
    with open_dataset(path) as dataset:
        if dataset.kind == "points" or dataset.calibration is None:
            raise InputError(
                f"{path}: holds tracked points, so its specimen and calibration cannot be replaced; import the points "
                "again"
            )
        dataset.refuse_without_state()
        beam = _same_beam(dataset, specimen)
        corrected = _calibration(dataset, dataset.calibration, calibration, changes or {})
        check_clicked_points(corrected, beam, dataset.frame_format()[0])
        before: dict[str, Document] = {"specimen": dataset.specimen, "calibration": dataset.calibration}
        after: dict[str, Document] = {"specimen": beam, "calibration": corrected}
        _check_coil_constant(dataset, dataset.calibration, corrected, calibration)
        is_run = dataset.text("protocol") is not None
        imported = _imported_motions(dataset)
        same_shape = _shape(beam) == _shape(dataset.specimen)
    changed = {name: differences(before[name].text, after[name].text) for name in before}
    same_places = same_shape and not changed["calibration"]
    if any(changed.values()):
        with rewritten(path, _LARGEST_TEXTS_BYTES) as entry:
            _replace(entry, {name: after[name] for name, lines in changed.items() if lines})
            if is_run:
                entry["states/field"][...] = corrected.mT_per_A * entry["states/current"][()]
                entry["data/field"][...] = corrected.mT_per_A * entry["data/set_current"][()]
            drop_edges(entry)
            if not same_places:
                drop_motions(entry)
        for kind in () if same_places else imported:
            tell(f"note: {path}: the imported {kind} is older than this correction and was removed; import it again")
    return tuple(f"{name}: {line}" for name, lines in changed.items() for line in lines)


def _shape(specimen: SpecimenFile) -> tuple[object, ...]:
    """Return the dimensions of a specimen, on which the places of tracked points depend."""
    beam = specimen.mechanics()
    magnet = beam.magnet
    of_magnet = (magnet.length_mm, magnet.width_mm, magnet.depth_mm, magnet.tip_offset_mm) if magnet else ()
    return beam.length_mm, beam.width_mm, beam.depth_mm, beam.rest_shape, of_magnet


def _imported_motions(dataset: Dataset) -> list[str]:
    """Return the kinds of the stored motions that cannot be measured again, because there are no frames of them."""
    recorded = recorded_kinds(dataset)
    kinds = ["ring-down"] if dataset.ring_downs() and "ring_down" not in recorded else []
    return kinds + (["creep"] if dataset.creeps() and "creep" not in recorded else [])


def _same_beam(dataset: Dataset, file: str | None) -> SpecimenFile:
    if file is None:
        return dataset.specimen
    corrected = load_specimen(file)
    name, other = dataset.specimen.specimen.name, corrected.specimen.name
    if name != other:
        raise InputError(
            f"{file}: specimen.name = {other!r}, but the specimen of {dataset.path} is {name!r}; if the file corrects "
            f"values of the same specimen, it should have specimen.name = {name!r}"
        )
    return corrected


def _calibration(dataset: Dataset, present: Calibration, file: Path | None, changes: Changes) -> Calibration:
    if file is None:
        corrected = changed_calibration(present, changes) if changes else present
    else:
        kept = {key: getattr(present, key) for key in missing_places(file, changes)}
        corrected = load_calibration(file, {**kept, **changes})
    region_of(corrected, dataset.frame_format()[0])
    return corrected


def _check_coil_constant(dataset: Dataset, before: Calibration, after: Calibration, file: Path | None) -> None:
    """Raise InputError for a new coil constant of an imported dataset, and if the constant of a run is left out.

    The fields of an imported dataset were perhaps typed, not computed.
    """
    if after.mT_per_A == before.mT_per_A:
        return
    if dataset.text("protocol") is not None:
        if not after.mT_per_A:
            raise InputError(
                f"{file}: coil_constant_mT_per_A is missing; the run used {before.mT_per_A:g}; give the coil constant"
            )
    elif after.mT_per_A or any(state.field_mT for state in dataset.states):
        raise InputError(
            f"{file}: coil_constant_mT_per_A = {after.mT_per_A:g}, but {dataset.path} was imported "
            f"with {before.mT_per_A:g}; perhaps states.csv contains typed fields, so repeat the import"
        )


def _replace(entry: h5py.Group, documents: Mapping[str, Document]) -> None:
    former = entry[FORMER] if FORMER in entry else group(entry, FORMER, "NXcollection")
    for name, document in documents.items():
        number = sum(other.startswith(f"{name}_") for other in former)
        entry.move(name, f"{FORMER}/{name}_{number}")
        put_text(former[f"{name}_{number}"], "date", now())
        note(entry, name, document.text, "application/toml")
        if isinstance(document, SpecimenFile):
            del entry["sample/description"], entry["title"]
            beam = document.specimen
            put_text(entry["sample"], "description", beam.material)
            put_text(entry, "title", f"{beam.name}, {beam.material}")
