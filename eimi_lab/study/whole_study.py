"""All of a study in order, each result stored as it is found."""

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
from eimi_lab.study.observed import experiment_of, field_mT, seen_edges_mm
from eimi_lab.study.open_questions import QUESTIONS
from eimi_lab.study.routes import Route, by_bending, by_tension, published_curves
from eimi_lab.study.stored_parts import StoredParts

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StudyInputs:
    """What a study is made of: how much, the seed of its searches, and published tensile curves by material."""

    extent: Extent
    seed: int = 1
    published: dict[str, Path] = field(default_factory=dict)

    @staticmethod
    def of(extent: Extent, seed: int, tensile_data: Path | None) -> StudyInputs:
        """With the curves that a folder holds. Raises InputError."""
        return StudyInputs(extent, seed, published_curves(tensile_data, extent.materials))

    def head(self) -> dict[str, Any]:
        """What two studies have to have in common to be one."""
        digests = {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in self.published.items()}
        return {"extent": asdict(self.extent), "seed": self.seed, "published": digests}


@dataclass(frozen=True)
class Findings:
    """All results: fields (K,) and edges (K, 2, n, 2) by material and type; bending fits by material, section and law;
    routes by material; errors by material, section and type, one a route; answers to the open questions.
    """

    inputs: StudyInputs
    fields: dict[str, Array]
    edges: dict[tuple[str, str], Array]
    bending: dict[tuple[str, str], list[dict[str, Any]]]
    tensile: dict[str, list[dict[str, Any]]]
    errors: dict[tuple[str, str, str], list[dict[str, Any]]]
    answers: dict[str, Any]

    def routes(self, material: str, section: str) -> list[Route]:
        """Those whose errors there are, in their order."""
        return [Route.of(stored) for stored in (*self.bending[material, section], *self.tensile[material])]


def steps(extent: Extent) -> int:
    """How many parts a study has."""
    specimens, sections = len(extent.materials) * len(extent.types), len(SECTIONS)
    fits = len(extent.materials) * (sections * len(extent.laws) + 1)
    return specimens + fits + specimens * sections + (len(QUESTIONS) if extent.open_questions else 0)


def find(inputs: StudyInputs, parts: StoredParts, report: Callable[[str], None] = silent) -> Findings:
    """Compute what is not stored yet; ``report`` is called after each part."""

    def part(name: str, found: Callable[[], Any]) -> Any:
        content = parts.part(name, found)
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
            seen = part(f"edges_{key}_{kind}", partial(_edges, key, kind, extent))
            edges[key, kind] = np.array(seen)
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
    """What is seen of a specimen, ready to be stored."""
    return list(seen_edges_mm(key, kind, extent).round(6).tolist())


def _tension(key: str, inputs: StudyInputs) -> list[dict[str, Any]]:
    """Tensile fits to the material's own curve, and to the published one where there is one."""
    found = by_tension(*MATERIALS[key].tensile_curve(), "own", inputs.extent)
    if key in inputs.published:
        test = read_tensile(inputs.published[key])
        found += by_tension(test.strain, test.stress_Pa, "published", inputs.extent)
    return found
