# Parts of a report: tables and figures as HTML and files, pieces of frames, choices among fits, and words.

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation
from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_fitting.laws import LAWS
from eimi_fitting.randomness import Randomness
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.reporting import frames, residual_noise, sections, shown, stress
from eimi_lab.reporting.contents import DatasetContents, ReportContents, short_names
from eimi_lab.reporting.elements import Cell, Elements, Picture, Table
from eimi_lab.reporting.frames import Crop
from eimi_lab.reporting.panel import DatasetPanel, all_panels
from eimi_lab.reporting.panels import magnified_residuals, residuals_along_beam
from eimi_lab.reporting.published_moduli import PUBLISHED
from eimi_lab.showing.drawing import Drawing, by_field, colours_in_order
from eimi_lab.showing.palette import LINES, MARKERS, PALETTE


def body(*cells: Any) -> str:
    # Return the HTML of the only row of a table.
    page = str(Elements().table(Table("name", "caption", [""] * len(cells), [cells])))
    return page.partition("<tbody><tr>")[2].partition("</tr></tbody>")[0]


@pytest.mark.parametrize(
    ("cell", "html"),
    [
        (24 * "a", f'<td class="short">{24 * "a"}</td>'),
        (25 * "a", f'<td class="long">{25 * "a"}</td>'),
        (12 * "a" + " " + 12 * "b", f"<td>{12 * 'a'} {12 * 'b'}</td>"),
        ("a < b", '<td class="short">a &lt; b</td>'),
        (Cell("a", "best"), '<td class="best short">a</td>'),
        (Cell(25 * "a", "best"), f'<td class="best long">{25 * "a"}</td>'),
        (Cell("<", "held"), '<td class="short">&lt; <span class="held">not measured</span></td>'),
        (("a", "b"), '<td class="short"><span class="line">a</span><br><span class="line">b</span></td>'),
        (
            ("a " * 16, "b " * 16 + "c"),
            f'<td><span class="line">{"a " * 16}</span><br>{"b " * 16}c</td>',
        ),
        (
            ("a", Cell("b", "best")),
            '<td class="best short"><span class="line">a</span><br><span class="line">b</span></td>',
        ),
    ],
)
def test_a_cell_of_a_table_as_html(cell: Any, html: str) -> None:
    assert body(cell) == html


@pytest.mark.parametrize(
    ("rows", "whole"),
    [
        ([["a", "b"]] * 14, True),
        ([["a", "b"]] * 15, False),
        ([["a", ("b", "c")]] * 7, True),
        ([["a", ("b", "c")]] * 8, False),
        ([[]] * 14, True),
        ([[]] * 15, False),
    ],
)
def test_a_table_of_14_lines_is_printed_on_one_page(rows: Any, whole: bool) -> None:
    page = str(Elements().table(Table("name", "caption", ["x", "y"], rows)))
    assert page.startswith(f'<div class="{"table whole" if whole else "table"}" id="table-1">')


def test_tables_are_numbered_and_have_notes() -> None:
    elements = Elements()
    first = str(elements.table(Table("one", "A & B", ["x", "<y>"], [["1", "2"]], ["a note", "another"])))
    assert first == (
        '<div class="table whole" id="table-1"><table><caption><b>Table 1.</b> A &amp; B</caption>'
        '<thead><tr><th scope="col">x</th><th scope="col">&lt;y&gt;</th></tr></thead>'
        '<tbody><tr><td class="short">1</td><td class="short">2</td></tr></tbody></table></div>'
        '<p class="note">a note</p><p class="note">another</p>'
    )
    assert 'id="table-2"><table><caption><b>Table 2.</b>' in elements.table(Table("two", "", ["x"], []))
    files = elements.files()
    assert list(files) == ["table_01_one.csv", "table_01_one.tex", "table_02_two.csv", "table_02_two.tex"]
    assert files["table_01_one.csv"] == b"x,<y>\n1,2\n"


def test_a_table_as_latex() -> None:
    signs = "&%$#_{}\\~^µ≥×±−³…<>Δλ°"
    rows = [[signs, ("a", Cell("b", "held"))], [Cell("c", "best"), "d"]]
    assert Table("name", "Two\n  lines", ["x_1", "y"], rows).to_latex() == "\n".join(
        [
            r"% Two lines",
            r"\begin{tabular}{ll}",
            r"\toprule",
            r"x\_1 & y \\",
            r"\midrule",
            r"\&\%\$\#\_\{\}\textbackslash{}\textasciitilde{}\textasciicircum{}\textmu{}$\geq$$\times$$\pm$$-$$^3$\ldots{}"
            r"\textless{}\textgreater{}$\Delta$$\lambda$$^\circ$ & a; b (not measured) \\",
            r"c & d \\",
            r"\bottomrule",
            r"\end{tabular}",
            "",
        ]
    )


class NotDrawn(Picture):
    # A picture that is not saved.

    embedded = "data:"  # type: ignore[assignment]


@pytest.mark.parametrize(
    ("width_in", "half", "beside", "width"),
    [
        (7.1, False, "", ""),
        (0.7501 * 7.1, False, "", ""),
        (0.7499 * 7.1, False, ' class="beside"', ' style="width: 75%"'),
        (3.55, False, ' class="beside"', ' style="width: 50%"'),
        (3.55, True, "", ""),
    ],
)
def test_a_narrow_figure_has_its_caption_beside_it(width_in: float, half: bool, beside: str, width: str) -> None:
    elements = Elements()
    for number in (1, 2):
        picture = NotDrawn("name", Drawing(1.0, width_in), "al<ternative", "caption", of_half_width=half)
        assert elements.figure(picture) == (
            f'<figure id="figure-{number}"{beside}><img src="data:" alt="al&lt;ternative"{width}>'
            f"<figcaption><b>Figure {number}.</b> caption</figcaption></figure>"
        )


@pytest.mark.parametrize(("photograph", "kind", "wide"), [(True, "webp", 220), (False, "svg+xml", 0)])
def test_a_photograph_is_stored_as_pixels(photograph: bool, kind: str, wide: int) -> None:
    import base64

    import cv2

    drawing = Drawing(0.5, 1.0)
    drawing.subplots()
    picture = Picture("name", drawing, "", "", photograph=photograph)
    start, _, content = picture.embedded.partition(",")
    assert start == f"data:image/{kind};base64"
    if wide:
        assert cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), 1).shape == (wide // 2, wide, 3)


def test_a_crop_of_images_has_brightness_from_0_to_1() -> None:
    crop = Crop(1, 0, 3, 2)
    assert crop.height_over_width == 1.0
    assert Crop(2, 3, 12, 8).height_over_width == 0.5
    grey = np.array([[0, 51, 102, 255], [5, 153, 204, 7]], np.uint8)
    assert crop.of(grey) == pytest.approx(np.array([[0.2, 0.4], [0.6, 0.8]]))
    deep = np.array([[9, 100, 200, 4000], [9, 300, 400, 9]], np.uint16)
    assert crop.of(deep) == pytest.approx(np.array([[0.25, 0.5], [0.75, 1.0]]))
    assert crop.of(np.zeros((2, 4), np.uint16)).tolist() == [[0.0, 0.0], [0.0, 0.0]]
    colour = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    assert 255 * crop.of(colour)[0, 0] == pytest.approx([5, 4, 3])
    assert Crop(3, 5, 9, 9).places(np.array([[4.0, 7.0]])).tolist() == [[1.0, 2.0]]


def photographed(edges: list[np.ndarray], pixels_per_mm: float = 8.0, length_mm: float = 50.0) -> Any:
    pair = SimpleNamespace(left=SimpleNamespace(points_mm=edges[0]), right=SimpleNamespace(points_mm=edges[1]))
    calibration = SimpleNamespace(pixels_per_mm=pixels_per_mm)
    specimen = SimpleNamespace(specimen=SimpleNamespace(length_mm=length_mm))
    dataset = SimpleNamespace(
        frame_format=lambda: ((300, 400, 3), "uint8"), edges=lambda: [pair], calibration=calibration, specimen=specimen
    )
    return SimpleNamespace(dataset=dataset)


@pytest.mark.parametrize(
    ("pixels_per_mm", "left_edge", "crop"),
    [
        (8.0, [[100.0, 60.0]], (76, 36, 244, 224)),  # 6 % of 50 mm are 24 pixels
        (2.0, [[100.0, 60.0]], (90, 50, 230, 210)),  # 10 pixels at least
        (8.0, [[10.0, 290.0]], (0, 176, 244, 300)),
        (8.0, [[390.0, 5.0]], (196, 0, 400, 224)),
    ],
)
def test_the_region_of_the_beam_has_a_margin(
    monkeypatch: pytest.MonkeyPatch, pixels_per_mm: float, left_edge: list[list[float]], crop: tuple[int, ...]
) -> None:
    monkeypatch.setattr(frames, "BeamFrame", lambda calibration: SimpleNamespace(to_px=lambda places: places))
    contents = photographed([np.array(left_edge), np.array([[220.0, 200.0]])], pixels_per_mm)
    assert frames.crop_of(contents) == Crop(*crop)
    assert frames.crop_of(photographed([np.zeros((0, 2))] * 2)) == Crop(0, 0, 400, 300)


def loaded(*loads: tuple[float, float]) -> Any:
    states = [SimpleNamespace(field_mT=field, tip_force_N=force) for field, force in loads]
    return SimpleNamespace(evidence=SimpleNamespace(states=states))


def test_some_states_are_spread_from_the_smallest_to_the_largest_load() -> None:
    assert frames.loads(loaded((-4.0, 0.0), (2.0, 0.01), (1.0, -0.02))).tolist() == [1.0, 1.0, 1.25]
    assert frames.loads(loaded((0.0, 0.0), (0.0, 0.5))).tolist() == [0.0, 1.0]
    five = loaded((3.0, 0.0), (0.0, 0.0), (-4.0, 0.0), (1.0, 0.0), (2.0, 0.0))
    assert [frames.some_states(five, most) for most in (1, 2, 3, 5, 9)] == [
        *([1], [1, 2], [1, 4, 2], [1, 3, 4, 0, 2], [1, 3, 4, 0, 2]),
    ]
    assert frames.some_states(loaded((1.0, 0.0), (1.0, 0.0), (1.0, 0.0)), 2) == [0, 2]


def test_only_measured_points_of_an_edge_are_drawn() -> None:
    points = np.arange(12.0).reshape(1, 2, 3, 2)
    sigma = np.array([[[0.1, math.inf, 0.1], [math.inf, 0.1, math.inf]]])
    contents: Any = SimpleNamespace(
        evidence=SimpleNamespace(experiment=SimpleNamespace(observed=EdgeObservation(points, sigma)))
    )
    left, right = frames.measured_mm(contents, 0)
    assert left.tolist() == [[0.0, 1.0], [4.0, 5.0]]
    assert right.tolist() == [[8.0, 9.0]]


@pytest.mark.parametrize(
    ("best", "index", "expected"), [(True, 7, [[1.0], [2.0]]), (True, 0, [[10.0]]), (False, 7, [])]
)
def test_the_drawn_edges_of_a_state_are_simulated_or_else_measured(
    monkeypatch: pytest.MonkeyPatch, best: bool, index: int, expected: list[list[float]]
) -> None:
    monkeypatch.setattr(frames, "frame_of", lambda contents: SimpleNamespace(to_px=lambda places: places))
    measured = [SimpleNamespace(left=SimpleNamespace(points_mm=[10.0]), right=SimpleNamespace(points_mm=[]))]
    contents: Any = SimpleNamespace(
        evidence=SimpleNamespace(states=[SimpleNamespace(index=4), SimpleNamespace(index=7)]),
        best=SimpleNamespace(edges_mm=[[[8.0], [9.0]], [[1.0], [2.0]]]) if best else None,
        dataset=SimpleNamespace(edges=lambda: measured if best else None),
    )
    assert frames.edges_px(contents, SimpleNamespace(index=index)) == expected  # type: ignore[arg-type]


def test_the_published_moduli_are_those_of_their_sources() -> None:
    # Stress at 100 % strain in psi, from the data sheets; a psi is 6894.757 Pa, and the stress of a Neo-Hookean
    # material at the stretch 2 is 1.75 times its shear modulus. 1.32 and 2.97 MPa are Young's moduli.
    sheets = {"Dragon Skin 10": 22, "Dragon Skin 20": 49, "Dragon Skin 30": 86}
    sheets |= {"Ecoflex 00-10": 8, "Ecoflex 00-20": 8, "Ecoflex 00-30": 10, "Ecoflex 00-50": 12}
    rows = [(row.material, row.low_Pa, row.high_Pa) for row in PUBLISHED if "Smooth-On" in row.source]
    assert [name for name, *_ in rows] == list(sheets)
    for name, low, high in rows:
        assert low == high == pytest.approx(sheets[name] * 6894.757 / 1.75, rel=1e-12)
    assert {(row.material, row.low_Pa, row.high_Pa) for row in PUBLISHED if "Smooth-On" not in row.source} == {
        ("Dragon Skin 10", 39650.0, 42140.0),
        ("Ecoflex 00-50", 18270.0, 21030.0),
        ("Sylgard 184", 0.44e6, 0.99e6),
    }


PANELS = [  # place, title, on the first pages, after the datasets, of fits alone, with intervals
    (0, "", True, False, False, False),
    (4, "Causes of the residuals", True, False, False, False),
    (6, "Published values", True, False, False, False),
    (9, "Viscoelastic law", False, False, True, False),
    (10, "Laws", False, False, True, False),
    (10, "Search", False, True, True, False),
    (15, "Uncertainty budget", False, False, True, False),
    (16, "Causes of the residuals of other fits", False, False, False, False),
    (17, "Correlation of the unknowns", False, False, True, False),
    (20, "Stability", False, True, True, False),
    (20, "Stress against strain", False, False, True, False),
    (29, "Errors by law and specimen", False, False, False, False),
    (30, "Each fit on each specimen", False, False, False, True),
    (30, "Provenance", False, True, False, False),
    (40, "Methods and references", False, True, False, False),
]


def test_the_places_of_the_panels() -> None:
    panels = [panel for panel in all_panels() if not isinstance(panel, DatasetPanel)]
    rows = [(p.place, p.title, p.summary, p.after_datasets, p.of_fits, p.of_intervals) for p in panels]
    assert sorted(rows) == PANELS
    assert [row[0] for row in rows] == [row[0] for row in PANELS]
    assert [(panel.place, panel.title) for panel in all_panels() if isinstance(panel, DatasetPanel)] == [
        (0, ""),
        (10, "Contact sheet"),
        (20, "Error against field"),
        (30, "Simulated and measured beam, with magnified residuals"),
        (40, "Residuals of {{ best.fitted_law.label }}"),
    ]


def test_the_best_fit_has_the_smallest_aicc_or_else_the_smallest_error() -> None:
    one, two = (SimpleNamespace(model=name, rmse_Pa=error) for name, error in (("yeoh", 2.0), ("ogden", 1.0)))

    def listed(of: Any, aicc: dict[str, float | None] | None, path: str = "a") -> Any:
        rows = tuple(Choice(n, 1, 55.0, a, 9 - (a or 0.0), None, 0.1) for n, a in (aicc or {}).items())
        return SimpleNamespace(fit=of, comparison=rows, path=path)

    by_error = [listed(one, None), listed(two, None)]
    assert shown.chosen(by_error) is by_error[1]
    by_aicc = [listed(one, {"yeoh": 0.0, "ogden": 1.0}), listed(two, {"yeoh": 0.0, "ogden": 1.0})]
    assert shown.chosen(by_aicc) is shown.chosen(by_aicc[::-1]) is by_aicc[0]
    by_bic = [listed(one, {"yeoh": None, "ogden": None}), listed(two, {"yeoh": None, "ogden": None})]
    assert shown.chosen(by_bic) is by_bic[0]
    mixed = [listed(one, {"yeoh": None, "ogden": 3.0}), listed(two, {"yeoh": None, "ogden": 3.0})]
    assert shown.chosen(mixed) is mixed[1]
    elsewhere = [listed(one, None, "b"), *by_aicc[1:]]
    assert shown.chosen(elsewhere) is elsewhere[1]


def test_styles_repeat_after_the_last() -> None:
    one = shown.ShownFit(Path("a"), 0, None, (), "bending")  # type: ignore[arg-type]
    for law, origin in ((0, 0), (2, 3), (5, 5), (6, 7)):
        styled = shown._styled(one, law, origin)
        assert styled.colour == PALETTE[law % 6]
        assert styled.marker == MARKERS[law % 6]
        assert styled.line == LINES[origin % 6]
    assert (one.colour, one.marker, one.line) == (PALETTE[0], MARKERS[0], LINES[0])


def test_short_names_have_as_many_folders_as_they_need() -> None:
    paths = [Path("a/b/x.h5"), Path("c/b/x.h5"), Path("c/b/y.h5")]
    assert short_names(paths[1:]) == ["x.h5", "y.h5"]
    assert short_names(paths) == [str(path) for path in paths]
    assert short_names([Path("r/a/b/x.h5"), Path("r/c/b/x.h5")]) == [str(Path("a/b/x.h5")), str(Path("c/b/x.h5"))]
    assert short_names([Path("x.h5"), Path("x.h5")]) == ["x.h5", "x.h5"]
    assert short_names([]) == []


def test_the_simulation_of_a_dataset_for_one_figure() -> None:
    def predicted(name: str, error: float, has_equilibrium: bool = True) -> Any:
        return SimpleNamespace(
            fitted_law=name, error_mm=np.array([error, error]), has_equilibrium=has_equilibrium, validation=name.upper()
        )

    every = (predicted("a", 0.3), predicted("b", 0.1, False), predicted("c", 0.2))
    contents = DatasetContents(None, None, every, "x")  # type: ignore[arg-type]
    assert [p.fitted_law for p in contents.simulated] == ["a", "c"]
    assert contents.validations == ["A", "B", "C"]
    assert contents.best is every[2]
    assert replace(contents, leading="a").best is every[0]  # type: ignore[arg-type]
    assert replace(contents, leading="b").best is every[2]  # type: ignore[arg-type]
    assert replace(contents, predictions=()).best is None


@pytest.mark.parametrize(
    ("mode", "stretch", "strain", "ratios"),
    [
        (stress.UNIAXIAL, 1.25, 0.25, (1.0, -0.5, -0.5)),
        (stress.PLANAR, 1.25, 0.25, (1.0, -1.0, 0.0)),
        (stress.SHEAR, 1.25, 1.25 - 0.8, (1.0, -1.0, 0.0)),
    ],
)
def test_a_stretch_is_a_strain_of_each_mode(
    mode: Any, stretch: float, strain: float, ratios: tuple[float, ...]
) -> None:
    assert mode.at_stretch(stretch) == pytest.approx(strain)
    assert mode.ratios == ratios
    # The Neo-Hookean stress: mu (λ - 1/λ²), mu (λ - 1/λ³), and mu times the shear.
    closed = {"uniaxial tension": 1.25 - 1.25**-2, "planar tension": 1.25 - 1.25**-3, "simple shear": strain}
    found = mode.stress_Pa(LAWS["neo-hookean"], np.array([4e4]), np.array([strain]))
    assert found == pytest.approx([4e4 * closed[mode.words]], rel=1e-9)


def test_the_probability_of_noise_in_words() -> None:
    assert [residual_noise._probability(p) for p in (0.00099, 0.001, 0.0123)] == ["p < 0.001", "p = 0.001", "p = 0.012"]


@pytest.mark.parametrize(
    ("tests", "answer", "end", "parts"),
    [
        (
            Randomness(200, 90, 0.0123, 0.251, 0.5, 1.234, 0.567),
            "yes",
            "The random part is 1.2 µm (root mean square).",
            "random part 1.2 µm",
        ),
        (
            Randomness(200, 30, 0.0001, 0.251, 0.5, 1.234, 0.567),
            "no",
            "which noise does not explain.",
            "random part 1.2 µm, systematic part 0.57 µm",
        ),
    ],
)
def test_the_noise_of_residuals_in_words(
    monkeypatch: pytest.MonkeyPatch, tests: Randomness, answer: str, end: str, parts: str
) -> None:
    given: list[Any] = []
    monkeypatch.setattr(residual_noise, "randomness_of", lambda residuals: given.append(residuals) or tests)
    observed = EdgeObservation(np.zeros((1, 2, 3, 2)), np.ones((1, 2, 3)))
    simulated: Any = SimpleNamespace(
        evidence=SimpleNamespace(experiment=SimpleNamespace(observed=observed)), residuals_mm=np.full((1, 2, 3), 0.002)
    )
    noise = residual_noise.residual_noise(simulated)
    assert noise is not None
    assert given[0].tolist() == np.full((1, 2, 3), 2.0).tolist()
    share = 100 * tests.sign_changes / 200
    assert noise.words.startswith(
        f"In {share:.0f} % of 200 pairs of neighbouring edge points the residuals differ in sign (noise: 50 %; runs "
        f"test, p {'= 0.012' if answer == 'yes' else '< 0.001'}). The correlation of the two residuals is 0.25 "
        "(noise: 0; p = 0.5). The random part is 1.2 µm "
    )
    assert noise.words.endswith(end)
    assert (noise.answer, noise.parts) == (answer, parts)
    monkeypatch.setattr(residual_noise, "randomness_of", lambda residuals: Randomness(9, 1, 0.5, 0.0, 0.5, 1.0, 0.0))
    few = residual_noise.residual_noise(simulated)
    assert few == residual_noise.ResidualNoise("too few points", "Only 9 pairs of neighbouring points could be tested.")
    points = PointObservation(np.zeros((2, 2)), np.zeros((1, 2, 2)), np.ones((1, 2)))
    simulated.evidence.experiment.observed = points
    assert residual_noise.residual_noise(simulated) is None


def test_a_place_on_the_bent_beam_is_a_place_on_the_straight_beam() -> None:
    edge = np.column_stack([np.linspace(0.0, 22.0, 12), np.zeros(12)])  # stretched from 20 mm to 22 mm
    places = np.array([[0.0, 1.0], [9.1, 2.0], [18.0, -1.0], [21.9, 0.0]])
    found = residuals_along_beam.along_beam_mm(edge, places, 20.0, 4.0)
    # Up to 18 mm the beam is soft: 16 mm became 18 mm. The last 4 mm are rigid.
    assert found == pytest.approx([0.0, 10.0 * 16 / 18, 16.0, 20.0])
    assert residuals_along_beam.along_beam_mm(edge, places[1:2], 20.0, 0.0) == pytest.approx([10.0 * 20 / 22])


@pytest.mark.parametrize(
    ("factor", "round_factor"),
    [
        (0.9999, 0.5),
        (1.0, 1.0),
        (1.99, 1.0),
        (2.0, 2.0),
        (4.99, 2.0),
        (5.0, 5.0),
        (9.99, 5.0),
        (372.0, 200.0),
        (0.03, 0.02),
    ],
)
def test_a_magnification_is_1_2_or_5_times_a_power_of_ten(factor: float, round_factor: float) -> None:
    assert magnified_residuals._round_down(factor) == pytest.approx(round_factor, rel=1e-12)


def test_the_axis_of_a_figure_is_the_field_or_the_number_of_the_state() -> None:
    x, words = by_field([1.0, 2.0], [5, 7])
    assert (x.tolist(), words) == ([1.0, 2.0], "field, mT")
    x, words = by_field([2.0, 2.0], [5, 7])
    assert (x.tolist(), words) == ([5.0, 7.0], "state")
    x, words = by_field([], [])
    assert (x.tolist(), words) == ([], "state")


def test_colours_go_from_the_smallest_to_the_largest_value() -> None:
    scale = colours_in_order(np.array([3.0, 1.0, 2.0]))
    assert scale.get_clim() == (1.0, 3.0)
    assert scale.get_cmap().name == "cividis"
    assert colours_in_order(np.zeros(0)).get_clim() == (0.0, 1.0)
    assert colours_in_order(np.full(2, 4.0)).get_clim() == (4.0, 4.0 + 1e-9)


def test_the_fits_of_a_report_by_kind() -> None:
    bending, tensile = (SimpleNamespace(fit=object.__new__(kind)) for kind in (FitRecord, TensileRecord))
    report = ReportContents((bending, tensile), (), None)  # type: ignore[arg-type]
    assert (report.bending, report.tensile, report.command, report.laws_of_time) == ([bending], [tensile], "", ())


def referenced(*datasets: tuple[str, str]) -> Any:
    fit = object.__new__(FitRecord)
    references = tuple(SimpleNamespace(sha256=sha256, section=section) for sha256, section in datasets)
    object.__setattr__(fit, "datasets", references)
    return SimpleNamespace(fit=fit)


def test_a_fit_is_simulated_with_its_section() -> None:
    both = referenced(("1", "solid"), ("2", "plane-stress"))
    assert [sections._section_of(both, sha256) for sha256 in "123"] == ["solid", "plane-stress", None]
    assert sections._section_of(referenced(("1", "solid"), ("2", "solid")), "3") == "solid"
    assert sections._section_of(SimpleNamespace(fit=object.__new__(TensileRecord)), "1") is None  # type: ignore[arg-type]
