"""The sag of a level beam gives its modulus at rest, with the effects of uncertain inputs on this modulus."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from eimi_fitting import LAWS, Loads, Specimen
from eimi_fitting.beam.rest_shape import RestShape, centre_line
from eimi_fitting.beam.strip import Strip
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.time.decay import Decay, RingMode
from eimi_fitting.time.evidence import RestEvidence, Sag
from eimi_fitting.time.measured import Motion
from eimi_fitting.time.ringing import RingTable
from eimi_fitting.time.ringing_beam import RingingBeam

STRIP = Specimen(40.0, 4.0, 10.0, 1070.0, section="plane-stress")
LEVEL = Loads.along([0.0], gravity_angle_deg=-90.0)
ALONG_MM = np.array([8.0, 16.0, 24.0, 32.0, 38.0])
ON_AXIS_MM = np.column_stack([ALONG_MM, np.zeros(5)])
AT_REST_PA, VIBRATING_PA = 130e3, 150e3


def beam_of(strip: Specimen, loads: Loads = LEVEL) -> RingingBeam:
    return RingingBeam(strip, loads, LAWS["neo-hookean"], np.ones(1))


def at_rest(beam: RingingBeam, rest_mm: np.ndarray) -> Motion:
    # Return the motion of points of a beam that is bent by its weight, with the modulus at rest of the material.
    model = beam.planar()
    places = model.positions(model.solve(beam.law, np.array([[AT_REST_PA]]), beam.loads), rest_mm)[0]
    time = np.repeat(np.arange(10.0)[:, None], len(rest_mm), axis=1)
    return Motion("ring_down", np.repeat(places, 10, axis=0), rest_mm, time, np.full(time.shape, 0.01))


def decay() -> Decay:
    none, mode = np.zeros(0), RingMode(6.0, 0.1, np.diag([1e-6, 1e-6]))
    return Decay("flick", (mode,), (), 0.0, 9.0, 1.0, 0.0, 0.0, none, none, none, none, 1.0)


def rest_of(beam: RingingBeam, motion: Motion) -> RestEvidence:
    table = RingTable(beam, VIBRATING_PA)
    sag = Sag.of(table, motion, decay())
    assert sag is not None
    rest = RestEvidence.of(sag, table)
    assert rest is not None
    return rest


@pytest.mark.parametrize(("source", "sigma"), [("width", 0.07), ("length", 0.2), ("gravity", 3.0)])
def test_an_uncertain_input_changes_the_modulus_at_rest_as_an_analysis_with_the_other_input_does(
    source: str, sigma: float
) -> None:
    beam = beam_of(STRIP, Loads.along([0.0], gravity_angle_deg=-60.0) if source == "gravity" else LEVEL)
    motion = at_rest(beam, ON_AXIS_MM)
    rest = rest_of(beam, motion)
    more, less = (rest_of(beam.under({source: np.array([sign * sigma])}), motion) for sign in (1, -1))
    expected = 0.5 * np.log(more.modulus_Pa / less.modulus_Pa)
    (effect,) = rest.effects({source: sigma})[source][:, 0]
    # The residual falls if the modulus from the sag rises.
    assert -effect * rest.sigma == pytest.approx(expected, rel=0.05)
    assert abs(expected) > 0.01


def test_inputs_that_change_neither_sag_nor_picture_have_no_effect_on_the_modulus_at_rest() -> None:
    beam = beam_of(STRIP)
    rest = rest_of(beam, at_rest(beam, ON_AXIS_MM))
    effects = rest.effects({"moment": 0.02, "width": 0.0})
    assert [effects["moment"][0, 0], effects["width"][0, 0]] == pytest.approx([0.0] * 2, abs=1e-9)


@pytest.mark.parametrize("length_mm", [40.0, 70.0])  # sags of 6 and of 40 mm
@pytest.mark.parametrize(("source", "sigma"), [("scale", 0.01), ("clamp", 0.3)])
def test_a_wrong_scale_or_a_shift_along_the_beam_shows_other_points_of_the_beam(
    source: str, sigma: float, length_mm: float
) -> None:
    beam, along = beam_of(replace(STRIP, length_mm=length_mm)), np.linspace(8.0, length_mm - 2.0, 9)
    motion = at_rest(beam, np.column_stack([along, np.zeros(9)]))
    rest = rest_of(beam, motion)
    curve = CubicSpline([0.0, *along], np.vstack([[0.0, 0.0], motion.points_mm[0]]))

    def log_modulus(error: float) -> float:
        # The picture is enlarged, or shifted along the beam.
        places = (1 + error) * curve(along / (1 + error)) if source == "scale" else curve(along - error)
        places = places + np.array([error if source == "clamp" else 0.0, 0.0])
        film = replace(motion, points_mm=np.broadcast_to(places, motion.points_mm.shape))
        return float(np.log(rest_of(beam, film).modulus_Pa))

    expected = 0.5 * (log_modulus(sigma) - log_modulus(-sigma))
    assert rest.effects({source: sigma})[source][0, 0] * rest.sigma == pytest.approx(expected, rel=0.1)
    assert abs(expected) > 0.003


def test_a_marker_at_the_clamp_keeps_the_effects_finite() -> None:
    beam, rest_mm = beam_of(STRIP), np.vstack([[0.0, 0.0], ON_AXIS_MM])
    effects = rest_of(beam, at_rest(beam, rest_mm)).effects({"width": 0.05, "clamp": 0.1, "scale": 0.01})
    assert all(np.isfinite(one).all() for one in effects.values())


@pytest.mark.parametrize(("source", "part"), [("clamp", 1), ("axis", 0)])
def test_an_error_of_the_picture_changes_the_modulus_at_rest(source: str, part: int) -> None:
    sigma = 0.2
    beam = beam_of(STRIP)
    motion = at_rest(beam, ON_AXIS_MM)
    rest = rest_of(beam, motion)
    image = Setup.of([(source, part, sigma)], 1)
    # The true places follow from those in the picture. The error of the picture has the opposite effect.
    moved = replace(motion, points_mm=image.corrected(motion.points_mm)[0])
    expected = np.log(rest_of(beam, moved).modulus_Pa / rest.modulus_Pa)
    assert -rest.effects({source: sigma})[source][part, 0] * rest.sigma == pytest.approx(expected, rel=0.15)
    assert abs(expected) > 0.005


def test_an_uncertain_shape_at_rest_changes_the_modulus_as_an_analysis_with_the_other_shape_does() -> None:
    beam = beam_of(STRIP)
    motion = at_rest(beam, ON_AXIS_MM)
    rest = rest_of(beam, motion)
    other = beam.under({"rest-shape": np.array([1.0, *np.zeros(len(SOURCES["rest-shape"].parts) - 1)])})
    # The points of a film count from the stated shape at rest.
    from_other = replace(motion, rest_mm=Strip(other.specimen).at_rest(ON_AXIS_MM))
    expected = np.log(rest_of(other, from_other).modulus_Pa / rest.modulus_Pa)
    effect = rest.effects({"rest-shape": 1.0})["rest-shape"][0, 0]
    assert -effect * rest.sigma == pytest.approx(expected, rel=0.2)
    assert abs(expected) > 0.05


def bowed(bow_mm: float) -> Specimen:
    # Return the strip, cast with a bow: its tip at rest is this far above the axis of the clamp.
    along = np.linspace(0.0, 40.0, 21)
    x = along * (1 - 2 / 3 * (bow_mm * along / 40.0**2) ** 2)
    line = centre_line(np.column_stack([x, bow_mm * (along / 40.0) ** 2]), 40.0)
    return replace(STRIP, rest_shape=RestShape(line, (), ()))


@pytest.mark.parametrize("bow_mm", [-1.0, 3.0, 6.0])
def test_a_strip_that_is_cast_with_a_bow_has_its_own_modulus_at_rest(bow_mm: float) -> None:
    strip = bowed(bow_mm)
    beam = beam_of(strip)
    rest = rest_of(beam, at_rest(beam, Strip(strip).at_rest(ON_AXIS_MM)))
    assert rest.modulus_Pa == pytest.approx(AT_REST_PA, rel=0.01)
