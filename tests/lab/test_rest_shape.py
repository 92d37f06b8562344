"""The shape of the beam at rest is given in specimen.toml, or measured in the states without a load."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting import LAWS, BeamModel, EdgeObservation, Experiment, Loads
from eimi_fitting.beam.outline import edge_curves, points_on
from eimi_fitting.beam.rest_modes import bend_offset, with_modes
from eimi_fitting.beam.strip import Strip
from eimi_fitting.inference.evidence.unknowns import shared
from eimi_fitting.inference.searching.measured_rest_shape import measured_rest_shape
from eimi_lab.config.materials import TrueMaterials
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse, to_toml
from eimi_lab.fits.assumptions import compressibility_remark
from eimi_lab.fits.evidence import Evidence, load_evidence
from eimi_lab.fits.fit_summary import evidence_remarks
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.fits.states_used import StatesUsed
from eimi_lab.process.errors import InputError
from eimi_lab.virtual.virtual_rig import open_virtual_rig
from eimi_lab.vision.edges.finding import find_edges

TYPE1 = load_specimen("type1")
BEAM = replace(TYPE1.mechanics(), section="plane-stress")
SIGMA_MM = 0.002
FIELD_MT = np.array([0.0, 1.5, 3.0, 4.5])


def stated(**keys: str) -> SpecimenFile:
    # Return the specimen "type1" of the program with other values of the keys of [specimen].
    text = "\n".join(line for line in TYPE1.text.splitlines() if line.partition(" ")[0] not in keys)
    for key, value in keys.items():
        text = text.replace("[specimen]", f"[specimen]\n{key} = {value}", 1)
    if "width_mm" in keys:  # this key of the magnet was removed, too
        text = text.replace("[magnet]", "[magnet]\nwidth_mm = 2.0", 1)
    return parse(SpecimenFile, text, "specimen.toml")


def experiment_with(specimen, loads: Loads, seed: int = 1) -> Experiment:
    # Return an experiment on the beam `specimen`, in which the beam model assumes the specimen "type1".
    model = BeamModel(specimen, 26, 3)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), loads)
    edges = points_on(edge_curves(model, shapes)[0], 4)[:, :, 6:-2]
    noisy = edges + SIGMA_MM * np.random.default_rng(seed).normal(size=edges.shape)
    sigma = np.full(edges.shape[2], SIGMA_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in noisy])
    return Experiment(BeamModel(BEAM), loads, observed)


def test_a_straight_beam_keeps_the_shape_in_its_file():
    assert measured_rest_shape(experiment_with(BEAM, Loads.along(FIELD_MT))) is None


def test_a_cast_bend_and_a_taper_are_measured_although_the_weight_straightens_the_beam():
    hidden = with_modes(BEAM, (0.8, -0.1), (0.04,))
    experiment = experiment_with(hidden, Loads.along(FIELD_MT))
    shape = measured_rest_shape(experiment)
    along = np.linspace(0, 1, 21)
    error_mm = bend_offset(shape.bends_mm, along) - bend_offset((0.8, -0.1), along)
    assert np.abs(error_mm).max() < 0.02
    shown_mm = experiment.observed.points_mm[0, :, -1, 1].mean()
    assert shown_mm < 0.75  # about 1 mm without the weight, which pulls the tip nearer to the axis of the clamp
    assert shape.widths_mm[0] == pytest.approx(0.04, abs=0.003)
    stated_sources = {source.source: source for source in shape.applied(experiment).stated}
    assert 0 < stated_sources["rest-shape"].standard_uncertainty < 0.03


def test_each_of_two_datasets_with_measured_shapes_has_its_own_error_of_the_shape():
    experiment = experiment_with(with_modes(BEAM, (0.8,)), Loads.along(FIELD_MT))
    shape = measured_rest_shape(experiment)
    of_both = [shape.applied(experiment, f"states of {name}").stated for name in ("a.h5", "b.h5")]
    assert [group.datasets for group in shared("rest-shape", of_both)] == [(0,), (1,)]


def test_no_shape_is_measured_without_a_state_at_rest_or_if_the_weight_bends_the_beam():
    hidden = with_modes(BEAM, (0.8,))
    assert measured_rest_shape(experiment_with(hidden, Loads.along(FIELD_MT[1:]))) is None
    assert measured_rest_shape(experiment_with(hidden, Loads.along(FIELD_MT, gravity_angle_deg=20.0))) is None


def test_a_fit_prints_the_effect_of_a_given_poisson_ratio():
    evidence = Evidence(
        Path("run.h5"), "", experiment_with(BEAM, Loads.along(FIELD_MT)), (), StatesUsed(4, (), ()), poisson_ratio=0.48
    )
    assert compressibility_remark(evidence) == (
        "run.h5: poisson_ratio = 0.48 means a bulk modulus of 24.7 shear moduli; the fit takes the material as "
        "incompressible, and its modulus is therefore about 1.3 % too low"
    )
    assert compressibility_remark(replace(evidence, poisson_ratio=0.5)) is None


def test_a_table_of_widths_is_used_by_the_model_and_is_written_unchanged():
    specimen = stated(width_mm="[[0.0, 3.4], [20.0, 2.6], [30.0, 2.6]]")
    assert specimen.specimen.width_mm == pytest.approx(2.8 + 1 / 15)
    strip = Strip(specimen.mechanics())
    assert strip.width_mm(np.array([0.0, 10.0, 25.0])) == pytest.approx([3.4, 3.0, 2.6])
    again = parse(SpecimenFile, to_toml(specimen), "again.toml")
    assert again.mechanics() == specimen.mechanics()


def test_a_centre_line_in_a_csv_file_becomes_part_of_the_text(tmp_path: Path):
    (tmp_path / "line.csv").write_text("x_mm,y_mm\n0,0\n10,0.2\n20,0.8\n29.9,1.8\n")
    text = TYPE1.text.replace("[specimen]", '[specimen]\nrest_shape = "line.csv"', 1)
    (tmp_path / "bent.toml").write_text(text)
    specimen = load_specimen(tmp_path / "bent.toml")
    assert "line.csv" not in specimen.text
    again = parse(SpecimenFile, specimen.text, "stored.toml")
    assert again.mechanics() == specimen.mechanics()
    offset_mm = Strip(specimen.mechanics()).at_rest(np.array([[20.0, 0.0]]))[0, 1]
    assert offset_mm == pytest.approx(0.8, abs=0.02)


# One point per mm with errors of 0.08 mm.
ROUGH = ", ".join(f"[{x}, {0.08 * (-1) ** x if x else 0}]" for x in range(31))


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"rest_shape": '"bent"'}, "rest_shape"),
        ({"rest_shape": "[[0, 0], [10, 0], [20, 0], [25, 0]]"}, "25 mm long, but the beam has length_mm = 30"),
        (
            {"rest_shape": f"[{ROUGH}]"},
            r"specimen.rest_shape: the centre line has a radius of [01]\.\d+ mm at .* half the width, 1\.5 mm: give",
        ),
        ({"width_mm": "[[0.0, 3.0]]"}, "at least two rows"),
        ({"width_mm": "[[1.0, 3.0], [30.0, 2.5]]"}, "the arc length of the first row should be 0"),
        (
            {"width_mm": "[[0.0, 3.0], [20.0, 2.5], [10.0, 2.5]]"},
            "increasing arc lengths, but 10 follows 20",
        ),
        (
            {"width_mm": "[[0.0, 3.0], [25.0, 2.5]]"},
            "ends at the arc length 25, but should end at specimen",
        ),
        ({"width_mm": "[[0.0, 3.0], [30.0, 1.0]]"}, "magnet.width_mm = 2 should be at most specimen.width_mm"),
    ],
)
def test_an_impossible_shape_is_refused_in_one_line(keys, words):
    with pytest.raises(InputError, match=words):
        stated(**keys)


def outline_mm(bench: str) -> np.ndarray:
    # Return the outline of a virtual beam without a current: n points, shape (n, 2), in mm.
    # bench: TOML text with the differences between the beam and its file.
    rig = load_rig("virtual")
    assert rig.virtual is not None
    silicone = '[silicone."Dragon Skin 10"]\nmodel = "neo-hookean"\nparameters = { mu_Pa = 46390.0 }\n'
    materials = parse(TrueMaterials, silicone + bench, "materials.toml")
    virtual = rig.virtual.model_copy(update={"materials": materials, "mesh": (8, 1, 1)})
    _, camera, _, _ = open_virtual_rig(rig.model_copy(update={"virtual": virtual}), TYPE1)
    return camera._beam.outlines_mm(0.0)[0]


def test_the_virtual_beam_has_the_shape_of_its_bench_and_hangs_straighter():
    plain, bent = outline_mm(""), outline_mm("[bench]\ncast_bend_mm = 1.0\n")
    tip_mm = np.abs(bent - plain)[len(bent) // 2, 1]
    assert 0.3 < tip_mm < 1.2
    wide = outline_mm("[bench]\ntaper_mm = -0.2\n")
    assert np.abs(wide[0, 1]) == pytest.approx(np.abs(plain[0, 1]) + 0.05, abs=1e-6)


@pytest.mark.parametrize(
    ("table", "half_mm"),
    [
        ("[[0.0, 4.0], [30.0, 2.4]]", lambda x: 2.0 - 0.8 * x / 30),
        ("[[0.0, 2.5], [23.0, 2.5], [23.0, 6.0], [30.0, 6.0]]", lambda x: np.where(x < 23, 1.25, 3.0)),
    ],
    ids=["tapered", "stepped"],
)
def test_the_edges_of_a_beam_of_varying_width_are_exact_and_raise_no_flags(table, half_mm):
    rig, specimen = load_rig("virtual"), stated(width_mm=table)
    assert rig.virtual is not None
    virtual = rig.virtual.model_copy(update={"mesh": (8, 1, 1)})
    _, camera, _, _ = open_virtual_rig(rig.model_copy(update={"virtual": virtual}), specimen)
    edges = find_edges(camera.grab(1.0).image, rig.calibration, specimen)
    assert not edges.flags
    for side, sign in ((edges.left, -1), (edges.right, 1)):
        x, y = side.points_mm.T
        assert len(x) > 60
        assert y == pytest.approx(sign * half_mm(x), abs=0.02)


@pytest.mark.slow
def test_a_run_with_a_bent_beam_gives_its_modulus_unless_the_file_says_that_the_beam_is_straight(
    tmp_path: Path, run
) -> None:
    rigs = Path(str(files("eimi_lab.protocols"))) / "rigs"
    for file in rigs.glob("virtual*.toml"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    with (tmp_path / "virtual_materials.toml").open("a") as materials:
        materials.write("\n[bench]\ncast_bend_mm = 1.0\ntaper_mm = -0.1\n")
    text = load_specimen("bench_example").text
    dataset, fits = tmp_path / "run.h5", tmp_path / "fits.json"

    def fitted(specimen: str) -> float:
        (tmp_path / "beam.toml").write_text(specimen)
        status, printed = run("segment", dataset, "--specimen", tmp_path / "beam.toml")
        assert status == 0, printed
        status, printed = run("fit", dataset, "--model", "neo-hookean", "-o", fits, "--force")
        assert status == 0, printed
        remarks = " ".join(evidence_remarks([load_evidence(dataset)]))
        assert ("bent by up to 0.9" in remarks) == ("rest_shape" not in specimen)
        return read_fits_file(fits).fits[0].initial_shear_modulus.value

    protocol, rig = "dragon_skin_10_quick", tmp_path / "virtual.toml"
    status, printed = run("acquire", protocol, "--specimen", "bench_example", "--rig", rig, "-o", dataset)
    assert status == 0, printed
    assert fitted(text) == pytest.approx(46390, rel=0.01)
    straight = text.replace("[specimen]", '[specimen]\nrest_shape = "straight"', 1)
    assert fitted(straight) == pytest.approx(46390 * 0.89, rel=0.03)
