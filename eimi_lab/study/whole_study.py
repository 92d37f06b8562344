"""Compute all parts of a study in order, and store each part as soon as it is computed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    """The inputs of a study: its extent, the seed of the searches, and the published tensile curves by material.

    The extent says which materials, specimens, laws and states are evaluated.
    """

    extent: Extent
    seed: int = 1
    published: dict[str, Path] = field(default_factory=dict)

    @staticmethod
    def of(extent: Extent, seed: int, tensile_data: Path | None) -> StudyInputs:
        """Return the inputs of a study, with the tensile curve of each material from the folder `tensile_data`.

        Without this folder, the study has no tensile curves. Raises InputError if the curve of a material is missing.
        """
        return StudyInputs(extent, seed, published_curves(tensile_data, extent.materials))

    def head(self) -> dict[str, Any]:
        """Return the inputs of a study as a dictionary for JSON.

        An interrupted study continues only with the same inputs.
        """
        digests = {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in self.published.items()}
        return {"extent": asdict(self.extent), "seed": self.seed, "published": digests}


@dataclass(frozen=True)
class Findings:
    """All results of a study.

    Attributes
    ----------
    inputs : StudyInputs
        The materials, specimens and laws that were evaluated, and the seed.
    fields : dict of ndarray, shape (K,)
        Fields of the K states in mT, by material.
    edges : dict of ndarray, shape (K, 2, n, 2)
        Measured edges in mm, by material and type of specimen. The axes are: state, left or right edge, n points, x and
        y.
    bending : dict of list
        Fits to the bending of a specimen of type 1, one for each law, by material and section assumption (model of the
        cross-section: in plane strain or as a solid). Types 1 to 4 are specimens of different dimensions.
    tensile : dict of list
        Fits to tensile curves, by material.
    errors : dict of list
        Errors of each identified law, by material, section assumption and type of specimen.
    answers : dict of list
        Answers to the questions that the paper leaves open, such as whether bending determines the compressibility, by
        name of the question; empty if these questions were not part of the study.
    """

    inputs: StudyInputs
    fields: dict[str, Array]
    edges: dict[tuple[str, str], Array]
    bending: dict[tuple[str, str], list[dict[str, Any]]]
    tensile: dict[str, list[dict[str, Any]]]
    errors: dict[tuple[str, str, str], list[dict[str, Any]]]
    answers: dict[str, Any]

    def routes(self, material: str, section: str) -> list[Route]:
        """Return the identified laws of a material, in the order in which the attribute `errors` has their errors.

        The laws fitted to bending come first, and the laws fitted to tensile curves follow.
        """
        return [Route.of(stored) for stored in (*self.bending[material, section], *self.tensile[material])]


def steps(extent: Extent) -> int:
    """Return the number of parts of a study: the results that are computed and stored one by one."""
    specimens, sections = len(extent.materials) * len(extent.types), len(SECTIONS)
    fits = len(extent.materials) * (sections * len(extent.laws) + 1)
    return specimens + fits + specimens * sections + (len(QUESTIONS) if extent.open_questions else 0)


def compute_all(inputs: StudyInputs, parts: StoredParts, report: Callable[[str], None] = silent) -> Findings:
    """Compute all parts of a study that are not stored, and return all results.

    A part is one result, such as the fit of one law. `report` is called with the name of each part when the part has
    been computed, or read because it was already stored.
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
    """Return the simulated measurement of the edges of a specimen as nested lists, for JSON.

    `key` is the material, `kind` the type of specimen, and `extent` the part of the study that is computed.
    """
    return list(measured_edges_mm(key, kind, extent).round(6).tolist())


def _tension(key: str, inputs: StudyInputs) -> list[dict[str, Any]]:
    """Return the fits to the tensile curve of a hidden material and, if there is one, to a published tensile curve.

    Hidden material: the true material of simulated specimens, which the fits do not know.
    """
    fits = by_tension(*MATERIALS[key].tensile_curve(), "own", inputs.extent)
    if key in inputs.published:
        test = read_tensile(inputs.published[key])
        fits += by_tension(test.strain, test.stress_Pa, "published", inputs.extent)
    return fits
