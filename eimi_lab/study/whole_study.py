"""Compute all parts of the study with simulated specimens in order, and store each result."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.fits.records import package_versions
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.process.progress import silent
from eimi_lab.study.errors_by_route import errors_of
from eimi_lab.study.extent import SECTIONS, TRAINED_ON, Extent
from eimi_lab.study.hidden_materials import MATERIALS
from eimi_lab.study.observed import experiment_of, field_mT, measured_edges_mm
from eimi_lab.study.open_questions import QUESTIONS
from eimi_lab.study.routes import Route, by_bending, by_tension, published_curves
from eimi_lab.study.stored_parts import StoredParts

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StudyInputs:
    """The inputs of a study: its size, the seed of the searches, and the published tensile curve of each material."""

    extent: Extent
    seed: int = 1
    published: dict[str, Path] = field(default_factory=dict)

    @staticmethod
    def of(extent: Extent, seed: int, tensile_data: Path | None) -> StudyInputs:
        """Return the inputs of a study, with the published tensile curves in the folder `tensile_data`.

        Without this folder, there are no published curves. Raises InputError if the curve of a material is missing.
        """
        return StudyInputs(extent, seed, published_curves(tensile_data, extent.materials))

    def head(self) -> dict[str, Any]:
        """Return the inputs of a study, and the versions of the packages, as a dictionary for JSON."""
        digests = {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in self.published.items()}
        return {
            "extent": asdict(self.extent),
            "seed": self.seed,
            "published": digests,
            "versions": package_versions(),
        }


@dataclass(frozen=True)
class Findings:
    """All results of a study. A section is a model of the cross-section: plane strain or solid.

    Attributes
    ----------
    inputs : StudyInputs
        Extent and seed.
    fields : dict of ndarray, shape (K,)
        Fields of K states in mT, by material.
    edges : dict of ndarray, shape (K, 2, n, 2)
        Measured edges in mm, by material and specimen; axes state, left and right edge, point, x and y.
    bending : dict of list
        Fits to bending, by material and section.
    tensile : dict of list
        Fits to tensile curves, by material.
    errors : dict of list
        Errors of the identified laws, by material, section and specimen.
    answers : dict of list
        Answers to open questions, by name of the question.
    """

    inputs: StudyInputs
    fields: dict[str, Array]
    edges: dict[tuple[str, str], Array]
    bending: dict[tuple[str, str], list[dict[str, Any]]]
    tensile: dict[str, list[dict[str, Any]]]
    errors: dict[tuple[str, str, str], list[dict[str, Any]]]
    answers: dict[str, Any]

    def routes(self, material: str, section: str) -> list[Route]:
        """Return the laws fitted to bending (``section``: plane-strain or solid), then those fitted to tension."""
        return [Route.of(stored) for stored in (*self.bending[material, section], *self.tensile[material])]


def steps(extent: Extent) -> int:
    """Return the number of results that a study computes and stores one by one."""
    specimens, sections = len(extent.materials) * len(extent.types), len(SECTIONS)
    fits = len(extent.materials) * (sections * len(extent.laws) + 1)
    return specimens + fits + specimens * sections + (len(QUESTIONS) if extent.open_questions else 0)


def compute_all(inputs: StudyInputs, parts: StoredParts, report: Callable[[str], None] = silent) -> Findings:
    """Compute all results of a study that are not stored, and return all results.

    `report` is called with the name of each result.
    """

    def part(name: str, compute: Callable[[], Any]) -> Any:
        content = parts.part(name, compute)
        report(name.replace("_", " "))
        return content

    extent = inputs.extent
    fields = {key: field_mT(MATERIALS[key], extent) for key in extent.materials}
    edges: dict[tuple[str, str], Array] = {}
    bending: dict[tuple[str, str], list[dict[str, Any]]] = {}
    tensile: dict[str, list[dict[str, Any]]] = {}
    errors: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for key in extent.materials:
        for kind in extent.types:
            edges[key, kind] = np.array(part(f"edges_{key}_{kind}", partial(_edges, key, kind, extent)))
        tensile[key] = part(f"tension_{key}", partial(_tension, key, inputs))
        for section in SECTIONS:
            trained = experiment_of(TRAINED_ON, edges[key, TRAINED_ON], fields[key], section)
            bending[key, section] = [
                part(f"bending_{key}_{section}_{law}", partial(by_bending, law, trained, inputs.seed))
                for law in extent.laws
            ]
            routes = [Route.of(stored) for stored in (*bending[key, section], *tensile[key])]
            for kind in extent.types:
                experiment = experiment_of(kind, edges[key, kind], fields[key], section)
                errors[key, section, kind] = part(
                    f"errors_{key}_{section}_{kind}", partial(errors_of, routes, experiment)
                )
    answers = {
        name: part(f"question_{name}", partial(question, extent, inputs.seed))
        for name, question in (QUESTIONS.items() if extent.open_questions else ())
    }
    return Findings(inputs, fields, edges, bending, tensile, errors, answers)


def _edges(key: str, kind: str, extent: Extent) -> list[Any]:
    return list(measured_edges_mm(key, kind, extent).round(6).tolist())


def _tension(key: str, inputs: StudyInputs) -> list[dict[str, Any]]:
    """Return the fits to the simulated tensile curve of a material and to a published curve, if there is one."""
    fits = by_tension(*MATERIALS[key].tensile_curve(), "own", inputs.extent)
    if key in inputs.published:
        test = read_tensile(inputs.published[key])
        fits += by_tension(test.strain, test.stress_Pa, "published", inputs.extent)
    return fits
