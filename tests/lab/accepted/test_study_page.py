"""The page of a study has the accepted tables, verdicts and sentences for invented results."""

# If a change of the page is wanted, read the differences before you copy a new page over the accepted one.

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

from eimi_lab.showing.drawing import STYLE
from eimi_lab.study import figures, pages
from eimi_lab.study.claims import in_words, verdicts
from eimi_lab.study.extent import SECTIONS, Extent
from eimi_lab.study.paper_tables import advantages, all_tables
from eimi_lab.study.whole_study import Findings, StudyInputs
from tests.lab.printed.described import described, differences, numbers

MATERIALS = ("dragon_skin_10", "ecoflex_00_50")
KINDS = ("type1", "type2", "type3", "type4")
VALUES = {
    "neo-hookean": [25.5e3],
    "yeoh": [24.25e3, -812.5, 33.0],
    "mooney-rivlin": [20.5e3, 4.75e3],
    "ogden": [41.5e3, 1.75, 812.0, 5.25, -1.5e3, -2.5],
}


def law(name: str, modulus_kPa: float, source: str = "bending", window: str = "", **more: Any) -> dict[str, Any]:
    given = {"law": name, "values": VALUES[name], "modulus_Pa": 1e3 * modulus_kPa, "source": source, "window": window}
    return {**given, **more}


def searched(name: str, modulus_kPa: float, number: int, not_fixed: tuple[str, ...] = ()) -> dict[str, Any]:
    counts = {"evaluations": 300 + number, "generations": 20 + number, "unconverged": 3 + number, "unstable": 2}
    errors = {"mean_error_mm": 1e-3 * (2.5 + number), "mean_deviation_mm": 1e-3 * (1.25 + number)}
    return law(name, modulus_kPa, **counts, **errors, not_fixed=not_fixed, max_stretch=1.2 + 0.01 * number)


def error(size_um: float | None, growth: float = 1.0) -> dict[str, Any]:
    if size_um is None:
        return {"error_mm": None, "deviation_mm": None, "edges_mm": None}
    by_state = 1e-3 * size_um * np.array([0.5, 1.0, 1.1, growth, 1.3 * growth])
    return {
        "error_mm": by_state.tolist(),
        "deviation_mm": (0.4 * by_state).tolist(),
        "edges_mm": edges(size_um).tolist(),
    }


def edges(size: float) -> np.ndarray:
    # Return both edges of a bent beam (mm).
    x = np.linspace(0.0, 20.0, 6)
    return np.array([np.stack([x, side + 0.01 * size * x**2], axis=1) for side in (1.5, -1.25)])


def invented(kinds: tuple[str, ...] = KINDS, answers: bool = True) -> Findings:
    # Return results of both materials: in one a law has no equilibrium, and errors grow with the field.
    bending, errors = {}, {}
    tensile: dict[str, Any] = {}
    for m, key in enumerate(MATERIALS):
        tensile[key] = [
            law("neo-hookean", 61.0 + m, "own", "20 %"),
            law("yeoh", 44.0 + m, "own", "full"),
            law("mooney-rivlin", 57.0, "own", "50 %"),
            *([law("yeoh", 39.5, "published", "100 %"), law("ogden", 71.0, "published", "full")] if m else []),
        ]
        for s, section in enumerate(SECTIONS):
            bending[key, section] = [
                searched("neo-hookean", 51.0 + m + 2 * s, m, ("mu", "alpha") if m else ()),
                searched("yeoh", 53.5 - m, 3 + s),
                searched("ogden", 55.25, 7),
            ]
            for k, kind in enumerate(kinds):
                size = 2.0 + 1.5 * s + 0.25 * k + (6.0 if kind == "type4" and not m else 0.0)
                lost = m == 1 and kind == "type3" and s == 1
                errors[key, section, kind] = [
                    error(size),
                    error(1.2 * size, 1.0 + 1.6 * m),
                    error(None if lost else 1.7 * size, 1.0 + 2.5 * m * s),
                    error(3.1 * size, 2.0),
                    error(None if m and s == 0 and kind == "type2" else 2.2 * size),
                    error(4.7 * size),
                    *([error(5.3 * size), error(3.6 * size)] if m else []),
                ]
    fields = {key: np.array([0.0, 2.0, 4.0, 6.0, 8.0]) for key in MATERIALS}
    extent = Extent(MATERIALS, kinds, tuple(VALUES), 5, (20.0, None))
    measured = {
        (key, kind): np.array([edges(0.0), edges(1.0 + k)]) for key in MATERIALS for k, kind in enumerate(kinds)
    }
    return Findings(StudyInputs(extent), fields, measured, bending, tensile, errors, questions() if answers else {})


def questions() -> dict[str, Any]:
    def compressible(ratio: float | None, found: tuple[float, float, float], number: int) -> dict[str, Any]:
        return {
            "bulk_over_shear": ratio,
            "solid_percent": -1.5 - number,
            "solid_error_um": 0.75 + number,
            "plane_strain_percent": 20.5 + number,
            "freed_percent": 3.25 + number,
            "freed_interval_percent": [2.5 - number, 4.5 + number],
            "bulk_over_shear_found": list(found),
        }

    def state(states: int, fit: float) -> dict[str, Any]:
        return {
            "states": states,
            "foretold_percent": {"0.1 px": 2.25 / states, "0.3 px": 6.75 / states},
            "fit_half_percent": fit,
            "fit_percent": -0.5 * fit,
        }

    return {
        "compressibility": [
            compressible(None, (9000.0, 800.0, 12000.0), 0),
            compressible(1000.0, (880.0, 700.0, 990.0), 1),
            compressible(50.0, (49.0, 50.0, 52.0), 2),
            compressible(20.0, (22.0, 21.0, 23.0), 3),
        ],
        "moment": [
            {
                "case": "exact",
                "percent": 0.25,
                "interval_percent": [-0.5, 1.25],
                "error_um": 1.5,
                "moment_percent": None,
                "correlation": None,
            },
            {
                "case": "5 % stronger",
                "percent": -7.5,
                "interval_percent": [-9.5, -5.25],
                "error_um": 2.5,
                "moment_percent": [4.75, 3.5, 6.0],
                "correlation": 0.98765,
            },
        ],
        "states": [state(2, 1.75), state(4, 1.0), state(8, 0.5)],
        "optimisers": [
            {
                "law": "yeoh",
                "optimiser": "CMA-ES",
                "to_one_percent": [1201, None, 1413.25],
                "evaluations": [300, 310, 330],
                "least_error_um": [1.25, 1.5, 1.75],
            },
            {
                "law": "yeoh",
                "optimiser": "Gauss-Newton",
                "to_one_percent": [44],
                "evaluations": [60],
                "least_error_um": [1.125],
            },
            {
                "law": "ogden",
                "optimiser": "Nelder-Mead",
                "to_one_percent": [None, None],
                "evaluations": [12345, 23456],
                "least_error_um": [4.5, 3.5],
            },
        ],
    }


_TOLD = re.compile(
    r"[-–]?\d[\d.]*\d|[-–]?\d|∞|–|\b(?:yes|no|neo-hookean|yeoh|ogden|mooney-rivlin|type\d|solid|plane-strain|never)\b"
)


def check(text: str, name: str, folder: Path) -> None:
    # Compare the numbers, laws, types and answers in each line of a page with the accepted ones.
    new = folder / name
    told = [" ".join(_TOLD.findall(line)) for line in text.splitlines() if line]
    new.write_text("\n".join(told) + "\n", encoding="utf-8")
    accepted = Path(__file__).parent / "study" / name
    known = accepted.read_text(encoding="utf-8") if accepted.exists() else ""
    assert told == known.splitlines(), f"the new page is {new}"


def page(findings: Findings) -> str:
    claims, tables = pages.claims_table(verdicts(findings)), all_tables(findings)
    pictures = {"errors.png": b"", "stress_strain.png": b""}
    return pages._page(findings, claims, tables, pictures, in_words(findings))


def test_the_page_of_a_whole_study_is_as_accepted(tmp_path: Path) -> None:
    check(page(invented()), "whole.txt", tmp_path)


def test_the_page_of_a_study_without_the_twisted_type_and_without_questions_is_as_accepted(tmp_path: Path) -> None:
    check(page(invented(KINDS[:3], answers=False)), "without type 4.txt", tmp_path)


def test_the_page_of_a_study_of_types_1_and_4_is_as_accepted(tmp_path: Path) -> None:
    check(page(invented(("type1", "type4"), answers=False)), "types 1 and 4.txt", tmp_path)


def test_a_study_has_a_table_for_each_question_and_each_material() -> None:
    findings = invented()
    with np.errstate(all="raise"):
        lines = [f"{a.material} {a.section} {a.tension.name}" for a in advantages(findings, ["type2"], "published")]
    assert lines == [f"ecoflex_00_50 {section} published curve, full" for section in SECTIONS]
    names = [table.name for table in all_tables(findings)]
    assert names == [
        *("searches", "parameters_dragon_skin_10", "parameters_ecoflex_00_50", "advantage"),
        *("compressibility", "moment", "states", "optimisers"),
    ]


def test_the_written_page_has_its_tables_and_its_printed_lines(tmp_path: Path) -> None:
    findings = invented(KINDS[:2], answers=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pages, "all_figures", lambda found: {"errors.png": b"picture"})
        printed = pages.write_pages(tmp_path, findings)
    files = sorted(file.name for file in tmp_path.iterdir())
    assert files == sorted(
        [
            *("advantage.csv", "claims.csv", "errors.png", "parameters_dragon_skin_10.csv"),
            *("parameters_ecoflex_00_50.csv", "searches.csv", "study.md"),
        ]
    )
    judged = verdicts(findings)
    assert [line[:3] for line in printed[: len(judged)]] == ["yes" if v.agrees else "no " for v in judged]
    assert printed[0] == f"{printed[0][:3]}  {judged[0].section}, {judged[0].material}: {judged[0].claim} " + (
        judged[0].evidence
    )
    assert printed[len(judged) : -1] == in_words(findings)
    assert printed[-1] == str(tmp_path / "study.md")
    assert (tmp_path / "errors.png").read_bytes() == b"picture"
    assert (tmp_path / "searches.csv").read_text().startswith("material,section,law,evaluations,generations,discarded")


def test_a_claim_that_is_not_confirmed_has_a_reason_that_depends_on_the_section() -> None:
    findings = invented()
    for key, section, kind in findings.errors:
        if section == "plane-strain":
            findings.errors[key, section, kind][1] = error(4.0, 30.0)
    reasons: dict[tuple[str, str], set[str]] = {}
    for one in verdicts(findings):
        sentences = one.evidence.split(". ", 1)
        if not one.agrees and "ogden has no equilibrium" not in one.evidence:
            reasons.setdefault((one.claim[:9], one.section), set()).add(sentences[1])
    for claim in ("All laws ", "The error"):
        planar, solid = (reasons[claim, section] for section in SECTIONS)
        assert len(planar) == len(solid) == 1
        assert planar != solid
        assert all("only" in words for words in solid)


def of_lines(axes: Any) -> list[str]:
    return [f"{line.get_color()} {line.get_linewidth()}: {numbers(line.get_data()[0])}" for line in axes.lines]


def test_the_figures_of_invented_results_are_as_accepted(tmp_path: Path) -> None:
    findings = invented(KINDS[:3], answers=False)
    inputs = replace(findings.inputs, extent=replace(findings.inputs.extent, materials=MATERIALS[1:]))
    findings = replace(findings, inputs=inputs)
    with matplotlib.rc_context(STYLE):
        drawn = {
            "stress": figures._stress_strain(findings),
            "boxes": figures._boxes(findings),
            "overlays": figures._overlays(findings),
            "by field": figures._by_field(findings),
        }
        lines = [" ".join(line.split()) for name, drawing in drawn.items() for line in described(drawing, name)]
        near = [inset for axes in drawn["overlays"].axes for inset in axes.child_axes]
        lines += [
            f"near {number} from {numbers((*axes.get_xlim(), *axes.get_ylim()))}" for number, axes in enumerate(near)
        ]
        lines += [f"near {number} {line}" for number, axes in enumerate(near) for line in of_lines(axes)]
    (tmp_path / "figures.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    known = (Path(__file__).parent / "study" / "figures.txt").read_text(encoding="utf-8").splitlines()
    wrong = differences(lines, known, relative=1e-3, absolute=1e-3)
    assert not wrong, "\n".join([*wrong, f"the new description is {tmp_path / 'figures.txt'}"])
