"""All public functions work one after another on the virtual rig, with texts, paths and objects as arguments."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import eimi_lab as eimi
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.fits.fits_file import Fits


def test_a_run_takes_texts_and_objects(bench, tmp_path):
    objects = (
        load_protocol(bench / "protocol.toml"),
        load_specimen(bench / "specimen.toml"),
        load_rig(bench / "rig.toml"),
    )
    by_object = eimi.acquire(*objects, tmp_path / "objects.h5", note="by objects")
    by_text = eimi.acquire(
        *(str(bench / f"{name}.toml") for name in ("protocol", "specimen", "rig")), str(tmp_path / "t.h5")
    )
    assert [state.current_A for state in by_object.states] == [state.current_A for state in by_text.states]
    assert np.array_equal(by_object.images(2), by_text.images(2))
    assert "3 states of frames" in repr(by_object)


def test_a_dry_run_lists_each_step_and_writes_nothing(bench, tmp_path):
    steps = eimi.acquire("dragon_skin_10", "type1", "bench_example", dry_run=True)
    assert sum(" stored: " in line for line in steps.lines) == 16
    assert repr(steps).splitlines() == list(steps.lines)
    with pytest.raises(eimi.InputError, match="output is missing"):
        eimi.acquire("dragon_skin_10", "type1", "virtual")


def test_a_listener_receives_each_event_of_a_run(bench, tmp_path):
    events = []
    files = [bench / "protocol.toml", bench / "specimen.toml", bench / "rig.toml"]
    eimi.acquire(*files, tmp_path / "run.h5", on_event=events.append).close()
    assert all(isinstance(event, eimi.Event) for event in events)
    names = [event.event for event in events]
    assert names.count("state_stored") == 3
    assert names[0] == "run_begun"
    assert names[-1] == "run_ended"


def test_an_error_in_a_listener_ends_the_run_with_the_coil_off(bench, tmp_path):
    events = []

    def listen(event: eimi.Event) -> None:
        events.append(event.event)
        if event.event == "state_stored":
            raise ZeroDivisionError("of the listener")

    files = [bench / "protocol.toml", bench / "specimen.toml", bench / "rig.toml"]
    with pytest.raises(ZeroDivisionError, match="of the listener"):
        eimi.acquire(*files, tmp_path / "run.h5", on_event=listen)
    assert events.count("state_stored") == 1
    assert "off_confirmed" in events


def test_an_open_dataset_is_segmented_and_stays_open(run):
    opened = eimi.open(str(run))
    assert eimi.open(opened) is opened
    again = eimi.segment(opened, calibration=opened.calibration, axis=opened.calibration.axis_angle_deg, force=True)
    assert again is opened
    assert all(len(edges.left.points_mm) > 50 for edges in opened.edges())


def test_a_fit_is_the_same_for_a_text_a_path_and_an_open_dataset(bench, fitted):
    by_text = eimi.fit(str(bench / "run.h5"), "neo-hookean")
    by_object = eimi.fit([eimi.open(bench / "run.h5")], "neo-hookean")
    for fit in (by_text, by_object):
        assert fit.parameters == fitted.parameters
    assert repr(fitted).startswith("<neo-hookean: initial shear modulus ")
    assert "<table>" in fitted._repr_html_()


def test_laws_are_compared_and_stored(bench, tmp_path):
    fits = eimi.fit(bench / "run.h5", ["neo-hookean", "yeoh"], output=tmp_path / "fits.json")
    assert [fit.model for fit in fits] == ["neo-hookean", "yeoh"]
    assert len(fits.comparison) == 2
    assert fits["yeoh"] is fits[1]
    with pytest.raises(eimi.InputError, match=r"there is no fit of 'yeo'; did you mean 'yeoh'\?"):
        fits["yeo"]
    stored = eimi.open_fits(str(tmp_path / "fits.json"))
    assert stored.model_dump() == fits.model_dump()
    assert "yeoh" in repr(stored)
    assert stored._repr_html_().count("<table>") == 2
    with pytest.raises(eimi.InputError, match=r"model = \['yeoh'\]"):
        eimi.fit(bench / "run.h5", "yeoh", each=True)


def test_a_prior_is_in_the_fit_and_in_its_file_and_is_printed(bench, fitted, tmp_path):
    without_prior = fitted.parameters["mu"]
    prior = eimi.Prior("mu", 0.98 * without_prior.value, 0.001 * without_prior.value)
    pulled = eimi.fit(bench / "run.h5", "neo-hookean", prior=prior, output=tmp_path / "fits.json")
    assert prior.mean < pulled.parameters["mu"].value < without_prior.value
    (stored,) = json.loads((tmp_path / "fits.json").read_text())["fits"]
    assert stored["priors"] == [{"parameter": "mu", "mean": prior.mean, "standard_deviation": prior.standard_deviation}]
    assert eimi.open_fits(tmp_path / "fits.json")[0].priors == (prior,)
    for words in (pulled._repr_html_(), "\n".join(pulled.caveats())):
        assert f"Prior on mu: {prior.mean:.5g} ± {prior.standard_deviation:.3g} Pa" in words
    page = eimi.report(bench / "run.h5", tmp_path / "report.html", fit=pulled)
    text = Path(page).read_text(encoding="utf-8")
    assert "with 1 prior on its parameters" in text
    assert "Prior on mu:" in text
    assert "priors" not in fitted.content()


def test_residuals_are_arrays_by_state_edge_and_arc_length(bench, fitted):
    residuals = fitted.residuals()
    assert residuals.edge == ("left", "right")
    assert residuals.distance_mm.shape == residuals.arc_length_mm.shape
    assert residuals.distance_mm.shape[:2] == (3, 2)
    errors = [state.error_mm for state in fitted.by_state]
    assert residuals.root_mean_square_mm == pytest.approx(errors, rel=1e-9)
    length_mm = eimi.open(bench / "run.h5").specimen.specimen.length_mm
    assert np.nanmax(residuals.arc_length_mm) == pytest.approx(length_mm, abs=1.5)
    assert np.nanmin(np.diff(residuals.arc_length_mm, axis=2)) > 0
    judged = eimi.validate(bench / "run.h5", fitted)
    assert judged.residuals().distance_mm == pytest.approx(residuals.distance_mm, abs=2e-4, nan_ok=True)
    assert "3 states" in repr(residuals)
    assert "<table>" in residuals._repr_html_()
    assert len(residuals.plot().axes) == 3


def test_residuals_of_a_stored_fit_name_the_function_that_computes_them(fitted, tmp_path):
    Fits.of([fitted]).write(tmp_path / "fits.json")
    stored = eimi.open_fits(tmp_path / "fits.json")[0]
    with pytest.raises(eimi.InputError, match=r"eimi.validate\(DATASET, fit\).residuals\(\)"):
        stored.residuals()


def test_fit_and_residuals_turn_into_labelled_arrays(fitted):
    pytest.importorskip("xarray")
    pytest.importorskip("pandas")
    labelled = fitted.to_xarray()
    assert float(labelled.value.sel(parameter="mu")) == fitted.parameters["mu"].value
    assert labelled.draw.sizes["unknown"] == len(fitted.draws.names)
    assert labelled.error.attrs["units"] == "mm"
    distances = fitted.residuals().to_xarray()
    assert distances.distance.dims == ("state", "edge", "point")
    table = fitted.residuals().to_pandas()
    assert len(table) == int(np.isfinite(fitted.residuals().distance_mm).sum())
    assert set(table.columns) == {"field_mT", "edge", "arc_length_mm", "distance_mm"}


def test_a_fit_is_validated_as_object_and_as_file(bench, fitted, tmp_path):
    path = tmp_path / "fits.json"
    Fits.of([fitted]).write(path)
    by_object = eimi.validate(eimi.open(bench / "run.h5"), fitted)
    by_file = eimi.validate(str(bench / "run.h5"), [path, str(path)][:1], output=tmp_path / "v.json")
    assert by_object[0].mean_error_mm == by_file[0].mean_error_mm
    assert json.loads((tmp_path / "v.json").read_text())["validations"][0]["status"] == "ok"
    assert "neo-hookean" in repr(by_object)
    assert "<table>" in by_object._repr_html_()
    assert len(by_object.plot().axes) == 1


def test_a_law_and_a_fit_are_simulated(bench, fitted, tmp_path):
    protocol, specimen = bench / "protocol.toml", load_specimen(bench / "specimen.toml")
    given_parameters = eimi.simulate(
        protocol, specimen, "neo-hookean", parameter={"mu": 46390.0}, output=tmp_path / "shapes"
    )
    assert given_parameters.tip_mm.shape == (3, 2)
    assert (np.diff(given_parameters.tip_angle_deg) > 0).all()
    assert (tmp_path / "shapes" / "tip.csv").is_file()
    assert np.allclose(
        given_parameters.tip_mm, eimi.simulate(protocol, specimen, "neo-hookean", parameter=["mu_Pa=46390"]).tip_mm
    )
    from_fit = eimi.simulate(str(protocol), specimen, fit=fitted)
    assert from_fit.tips.shape == (3, 3, 2)
    assert "3 states" in repr(from_fit)
    assert "<table>" in from_fit._repr_html_()
    assert from_fit.plot()._repr_png_()[:4] == b"\x89PNG"


def test_the_next_run_is_planned(bench, fitted, tmp_path):
    toml = [bench / f"{name}.toml" for name in ("protocol", "specimen", "rig")]
    planned = eimi.plan(fitted, *toml, states=3, output=tmp_path / "planned.toml")
    assert len(planned.protocol.currents_A) == 3
    assert load_protocol(tmp_path / "planned.toml").currents_A == planned.protocol.currents_A
    assert "best run:" in repr(planned)
    assert "<table>" in planned._repr_html_()


def test_a_tensile_curve_is_fitted_exported_and_used_for_discovery(bench, tmp_path):
    strain = np.linspace(0.02, 1.0, 30)
    rows = (f"{e},{46.0 * (1 + e - (1 + e) ** -2)}" for e in strain)
    curve = tmp_path / "curve.csv"
    curve.write_text("\n".join(["strain,stress_kPa", *rows]) + "\n")
    fits = eimi.tensile(str(curve), "neo-hookean", window=50, output=tmp_path / "tensile.json")
    assert fits[0].initial_shear_modulus.value == pytest.approx(46e3)
    card = eimi.export(fits, to="abaqus", bulk_ratio=2000.0)
    assert card == eimi.export(tmp_path / "tensile.json", "neo-hookean", to="abaqus", bulk_ratio=2000.0).replace(
        "tensile.json", "(in memory)"
    )
    terms = eimi.discover(bench / "run.h5", tensile=curve, term=["i1", "i2"], most_terms=1, output=tmp_path / "d.json")
    assert terms.statement == json.loads((tmp_path / "d.json").read_text())["statement"]
    assert "<table>" in terms._repr_html_()
    assert terms.statement in repr(terms)


def test_pictures_and_points_are_imported(bench, tmp_path):
    run = eimi.open(bench / "run.h5")
    (tmp_path / "frames").mkdir()
    for state in run.states:
        cv2.imwrite(str(tmp_path / "frames" / f"{state.index}.png"), run.images(state.index, 1)[0])
    table = "\n".join(["frame,current_A", *(f"{state.index},{state.current_A}" for state in run.states)])
    (tmp_path / "states.csv").write_text(table + "\n")
    given = (tmp_path / "states.csv", bench / "specimen.toml", run.calibration)
    imported = eimi.import_pictures(str(tmp_path / "frames"), *given, tmp_path / "pictures.h5")
    assert [state.field_mT for state in imported.states] == pytest.approx([state.field_mT for state in run.states])
    (tmp_path / "points.csv").write_text("state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm\n0,p,20,0,19.9,1.0,0.02\n")
    (tmp_path / "loads.csv").write_text("state,field_mT\n0,2.0\n")
    points = eimi.import_points(
        tmp_path / "points.csv",
        tmp_path / "loads.csv",
        bench / "specimen.toml",
        tmp_path / "points.h5",
        gravity_angle=0.0,
    )
    assert points.kind == "points"
