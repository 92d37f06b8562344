"""What a dataset states, corrected after it was made: other files take the place of its own, which it keeps.

What was found by the former ones goes. The fields of a run follow from its currents, and so do they by another coil
constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import h5py

from eimi_lab.config.calibration import Calibration, Changes, changed_calibration, load_calibration, missing_places
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import Document, differences
from eimi_lab.dataset.layout import group, note, now, put_text
from eimi_lab.dataset.reading import FORMER, Dataset, open_dataset
from eimi_lab.dataset.rewriting import rewritten
from eimi_lab.dataset.stored_edges import drop_edges
from eimi_lab.process.errors import InputError
from eimi_lab.vision.edges.region import region_of

_OF_A_FILE_BYTES = 1 << 16


def restate(
    path: Path, *, specimen: str | None = None, calibration: Path | None = None, changes: Changes | None = None
) -> tuple[str, ...]:
    """Give a dataset of frames other files, or a calibration with other values, and remove its edges.

    changes: values in place of the calibration's own. Places that the calibration's file leaves out stay as they are.
    Returns what is different, a line a key; where nothing is, the dataset stays as it is.
    Raises InputError, naming the key where the files cannot be this dataset's.
    """
    with open_dataset(path) as dataset:
        if dataset.calibration is None:
            raise InputError(f"{path}: holds tracked points, which need no segmentation; import them again")
        before: dict[str, Document] = {"specimen": dataset.specimen, "calibration": dataset.calibration}
        after: dict[str, Document] = {
            "specimen": _same_beam(dataset, specimen),
            "calibration": _calibration(dataset, dataset.calibration, calibration, changes or {}),
        }
        factor = _field_factor(dataset, dataset.calibration, after["calibration"], calibration)
    told = {name: differences(before[name].text, after[name].text) for name in before}
    if any(told.values()):
        with rewritten(path, _OF_A_FILE_BYTES) as entry:
            _replace(entry, {name: after[name] for name, lines in told.items() if lines})
            for place in ("states/field", "data/field"):
                if factor != 1.0:
                    entry[place][...] = factor * entry[place][()]
            drop_edges(entry)
    return tuple(f"{name}: {line}" for name, lines in told.items() for line in lines)


def _same_beam(dataset: Dataset, file: str | None) -> SpecimenFile:
    if file is None:
        return dataset.specimen
    found = load_specimen(file)
    name, other = dataset.specimen.specimen.name, found.specimen.name
    if name != other:
        raise InputError(
            f"{file}: specimen.name = {other!r}, where {dataset.path} was taken of {name!r}: is it the file of another "
            f"specimen? One that corrects this one's numbers has the name {name!r}"
        )
    return found


def _calibration(dataset: Dataset, own: Calibration, file: Path | None, changes: Changes) -> Calibration:
    if file is None:
        found = changed_calibration(own, changes) if changes else own
    else:
        kept = {key: getattr(own, key) for key in missing_places(file, changes)}
        found = load_calibration(file, {**kept, **changes})
    region_of(found, dataset.frame_format()[0])
    return found


def _field_factor(dataset: Dataset, before: Calibration, after: Document, file: Path | None) -> float:
    """By which the fields change."""
    assert isinstance(after, Calibration)
    factor = after.coil_constant_mT_per_A / before.coil_constant_mT_per_A
    if factor != 1.0 and dataset.text("protocol") is None:
        raise InputError(
            f"{file}: coil_constant_mT_per_A = {after.coil_constant_mT_per_A:g}, where {dataset.path} was imported "
            f"with {before.coil_constant_mT_per_A:g}; its states.csv may state fields: import it again"
        )
    return factor


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
