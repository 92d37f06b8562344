"""The virtual bench refuses what it cannot compute, and the outline of its moving beam follows the computed rod."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.interfaces import InstrumentError
from eimi_fitting import Magnet, Specimen
from eimi_lab.config.materials import TrueMaterial
from eimi_lab.config.rig import Rig, load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.process.errors import InputError
from eimi_lab.virtual import moving_beam, virtual_rig
from eimi_lab.virtual.beam import LOSS_FACTOR, VirtualBeam, VirtualLoads
from eimi_lab.virtual.client_rig import with_virtual_table
from eimi_lab.virtual.moving_beam import MovingBeam
from eimi_lab.virtual.moving_outlines import MovingOutlines
from eimi_lab.virtual.rod import Rod, Stiffness
from eimi_lab.virtual.simulation import parse_parameters, simulate
from eimi_lab.virtual.virtual_rig import VirtualCamera, truth_of
from eimi_lab.vision.beam_frame import BeamFrame

MAGNET = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, section="solid", magnet=MAGNET)
STIFFNESS = Stiffness(0.025, 9.7e-8)


def along_gravity(field_mT: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([0.0, 1e-3 * field_mT]), np.array([9.8, 0.0])


def planar() -> SpecimenFile:
    return parse(SpecimenFile, load_specimen("type1").text.replace('"solid"', '"plane-strain"'), "type1")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"bulk_modulus_kPa": 0.0}, "--bulk-modulus-kPa 0: should be greater than 0"),
        ({"bulk_modulus_kPa": math.inf}, "--bulk-modulus-kPa inf: should be greater than 0"),
        ({"gravity_angle_deg": math.nan}, "--gravity-angle nan: should be an angle in degrees, such as 90"),
        ({"field_angle_deg": math.inf}, "--field-angle inf: should be an angle in degrees, such as 90"),
        ({"field_mT": np.array([0.0, math.nan])}, "--coil-constant: the fields are not finite"),
        ({"parameters": np.array([0.0])}, "the initial shear modulus of neo-hookean is 0 Pa; it should be above 0"),
    ],
)
def test_inputs_that_cannot_be_simulated_are_refused(changed: dict[str, Any], words: str) -> None:
    law, values = parse_parameters("neo-hookean", ["mu_Pa=46390"])
    given = {"parameters": values, "field_mT": np.array([0.0]), "gravity_angle_deg": 0.0} | changed
    with pytest.raises(InputError, match=words):
        simulate(planar(), law, **given)
    stress = parse(SpecimenFile, load_specimen("type1").text.replace('"solid"', '"plane-stress"'), "type1")
    with pytest.raises(InputError, match="plane stress is computed for incompressible materials only"):
        simulate(stress, law, values, np.array([0.0]), 0.0, bulk_modulus_kPa=1e3)


def test_a_step_without_a_solution_is_shortened_to_a_microsecond_before_the_beam_is_given_up() -> None:
    # Steps of 2 ms, each 0.3 times the step before, are tried down to the first one below 1 microsecond.
    beam = MovingBeam(BEAM, STIFFNESS, 50e3, None, along_gravity)
    beam.start(0.0, 0.0)
    parts = []

    def unsolved(constant: Any, part: float, loads: Any) -> None:
        parts.append(part)

    beam._solved = unsolved  # type: ignore[method-assign, assignment]
    with pytest.raises(ArithmeticError, match="could not be computed at 0 s"):
        beam.advance(1.0, lambda _: 1.0)
    half = 0.5 * (2.0 - math.sqrt(2.0))
    assert parts == pytest.approx([half * 2e-3 * 0.3**k for k in range(8)])


def test_the_steps_grow_after_the_motion_and_end_at_the_asked_time() -> None:
    beam = MovingBeam(BEAM, STIFFNESS, 50e3, None, along_gravity, 1.0)
    beam.start(0.0, 0.0)
    beam.advance(30.0, lambda _: 1.0)
    assert beam.time_s == 30.0
    assert 0.5 < beam._step_s <= 5.0
    later = beam.advance(0.0, lambda _: 1.0, np.array([30.0, 31.0, 31.0]))
    assert later.shape == (3, beam.rod.size)
    assert later[1] == pytest.approx(later[2])
    assert beam.time_s == 31.0


def test_a_weak_field_moves_the_beam_in_the_same_way_as_a_stronger_one() -> None:
    # The permitted error of a step is relative to the motion: motions in weak fields are proportional to the field.
    swings = []
    for field_mT in (0.001, 0.1):
        beam = MovingBeam(BEAM, STIFFNESS, 50e3, None, along_gravity, 0.1)
        beam.start(0.0, 0.0)
        swings.append(beam.advance(0.0, lambda _, field_mT=field_mT: field_mT, np.array([0.25, 0.5]))[:, 0] / field_mT)
    assert swings[0] == pytest.approx(swings[1], abs=0.02 * np.abs(swings[1]).max())


def test_no_equilibrium_of_the_rod_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    # A residual of more than 1e-6 of the largest one is no equilibrium.
    beam = MovingBeam(BEAM, STIFFNESS, 50e3, None, along_gravity)
    for residual, is_refused in ((2e-6, True), (-2e-6, True), (0.5e-6, False)):
        solved = SimpleNamespace(fun=np.array([0.0, residual]), x=np.arange(7.0))
        monkeypatch.setattr(moving_beam.scipy.optimize, "root", lambda *arguments, solved=solved, **options: solved)
        if is_refused:
            with pytest.raises(ArithmeticError, match="no equilibrium of the moving beam was found at 3 mT"):
                beam.at_rest(3.0)
        else:
            assert beam.at_rest(3.0).tolist() == list(range(7))


def test_the_losses_of_a_beam_without_a_series_have_the_loss_factor_at_its_lowest_frequency() -> None:
    # The viscosity, times the lowest angular frequency of the equations of motion, is the loss factor.
    beam = MovingBeam(BEAM, STIFFNESS, 50e3, None, along_gravity, 0.2)
    other = MovingBeam(BEAM, STIFFNESS, 4 * 50e3, None, along_gravity, 0.2)
    frequency = 0.2 / beam._viscosity_s
    beam.start(0.0, 0.5)
    swing = MovingBeam(BEAM, STIFFNESS, 50e3, None, along_gravity)
    swing.start(0.0, 0.1)
    times = np.arange(1, 801) * 2e-3
    turn = swing.advance(0.0, lambda _: 0.0, times)[:, 0]
    largest = int(np.abs(np.fft.rfft(turn * np.hanning(800), 8000)).argmax())
    assert frequency == pytest.approx(2.0 * math.pi * largest / (8000 * 2e-3), rel=0.03)
    assert 0.5 < other._viscosity_s / beam._viscosity_s < 0.65  # gravity, which does not grow, stiffens the beam


def test_a_rod_without_softening_is_linear_and_a_beam_without_losses_has_no_viscosity() -> None:
    rod = Rod(BEAM, STIFFNESS)
    z, speed = np.random.default_rng(1).normal(0.0, 0.5, (2, rod.size))
    assert rod.strain(z) == pytest.approx(z)
    assert rod.strain_rate(z, speed) == pytest.approx(speed)
    assert MovingBeam(BEAM, STIFFNESS, 50e3, None, along_gravity)._viscosity_s == 0.0


def moving_outlines() -> tuple[MovingBeam, MovingOutlines]:
    beam = MovingBeam(BEAM, STIFFNESS, 50e3, None, along_gravity)
    along = np.linspace(0.0, 30.0, 13)

    def outlines(field_mT: float) -> tuple[np.ndarray, np.ndarray]:
        left, right = (np.column_stack([along, np.full(13, side)]) for side in (-1.5, 1.5))
        corners = np.array([[26.0, -1.5], [30.0, -1.5], [30.0, 1.5], [26.0, 1.5]])
        return np.concatenate([left, right[::-1]]), corners

    return beam, MovingOutlines(outlines, beam, BEAM, 6.0)


def test_points_of_the_outline_move_with_the_strain_at_their_place() -> None:
    # With an even strain of 0.01, a point moves along the beam by 0.01 times its distance from the begin of the rod.
    # The rod is 25 mm long and begins 1 mm from the clamp; beyond its end at 26 mm, all points move alike.
    beam, shapes = moving_outlines()
    rest = beam.at_rest(0.0)
    stretched = rest.copy()
    stretched[4] += 0.01
    moved = shapes.at(stretched)
    grown = moved[0] - shapes.at(rest)[0]
    expected = 0.01 * np.clip(np.linspace(0.0, 30.0, 13) - 1.0, 0.0, 25.0)
    assert grown[:13, 0] == pytest.approx(expected, abs=1e-3)
    assert grown[13:, 0] == pytest.approx(expected[::-1], abs=1e-3)
    assert np.abs(grown[:, 1]).max() < 1e-6
    assert moved[1] - shapes.at(rest)[1] == pytest.approx(np.tile([0.25, 0.0], (4, 1)), abs=1e-3)


def test_the_tip_of_the_outline_turns_with_the_magnet_about_the_end_of_the_rod() -> None:
    # If only the hinge turns by 0.05 beside the shape at rest with the same tip angle, the outline follows the rod.
    beam, shapes = moving_outlines()
    turned = beam.at_rest(0.0)
    turned[3] += 0.05
    outline, magnet = shapes.at(turned)
    field = float(np.interp(beam.rod.end @ turned, shapes._turned, shapes._fields))
    rod = beam.rod
    along, across = np.array([26.0, 30.0, 30.0, 26.0]) / 26.0, np.array([-1.5, -1.5, 1.5, 1.5])
    shift = rod.places_mm(turned, along, across) - rod.places_mm(beam.at_rest(field), along, across)
    corners = np.array([[26.0, -1.5], [30.0, -1.5], [30.0, 1.5], [26.0, 1.5]])
    assert magnet == pytest.approx(corners + shift, abs=2e-3)
    assert outline[[12, 13]] == pytest.approx(corners[1:3] + shift[1:3], abs=2e-3)
    assert outline[[0, -1]] == pytest.approx(np.array([[0.0, -1.5], [0.0, 1.5]]), abs=1e-6)


def rig_with(**of_rig: Any) -> Rig:
    return load_rig("virtual").model_copy(update=of_rig)


def test_the_truth_has_the_series_of_a_material_and_only_the_stated_properties_of_the_bench() -> None:
    rig, specimen = load_rig("virtual"), load_specimen("type1")
    assert rig.virtual is not None
    silicone = rig.virtual.materials.silicone
    name = specimen.specimen.material
    series = silicone[name].model_copy(update={"prony_h": (0.1, 0.2), "prony_tau_s": (1.0, 2.0)})
    elastic = silicone[name].model_copy(update={"prony_h": (), "prony_tau_s": ()})
    for material, has_series in ((series, True), (elastic, False)):
        materials = rig.virtual.materials.model_copy(update={"silicone": {name: material}, "bench": None})
        changed = rig_with(virtual=rig.virtual.model_copy(update={"materials": materials}))
        truth = truth_of(changed, specimen)
        assert ("prony_h" in truth, "prony_tau_s" in truth, "bench" in truth) == (has_series, has_series, False)
        assert truth["parameters"] == material.parameters
        if has_series:
            assert truth["prony_h"] == (0.1, 0.2)


def camera(beam: Any, **changed: Any) -> VirtualCamera:
    rig = load_rig("virtual")
    coil = SimpleNamespace(coil_current_A=lambda: 0.3)
    given = {"background_mT": 0.5, "frame_rate_Hz": None, "specimen": None, "strongest_mT": 6.0} | changed
    return VirtualCamera(beam, coil, SimulatedClock(), BeamFrame(rig.calibration), 4.0, rig.virtual, **given)


def test_a_beam_without_an_equilibrium_is_an_error_of_the_camera() -> None:
    def refuse(field_mT: float) -> None:
        raise ArithmeticError("no equilibrium")

    broken = SimpleNamespace(relaxes=False, moves=lambda field: True, outlines_mm=refuse)
    with pytest.raises(InstrumentError, match="virtual camera: no equilibrium"):
        camera(broken).grab(1.0)


def test_the_true_field_reverses_with_the_leads_and_keeps_the_background() -> None:
    seen = camera(SimpleNamespace(relaxes=False))
    assert seen.field_mT() == pytest.approx(0.5 + 4.0 * 0.3)
    seen.swap_leads()
    assert seen.field_mT() == pytest.approx(0.5 - 4.0 * 0.3)
    seen.swap_leads()
    assert seen.field_mT() == pytest.approx(0.5 + 4.0 * 0.3)
    closed: list[bool] = []

    class Remote(virtual_rig.RemoteCoil):
        def __init__(self) -> None:
            pass

        def close(self) -> None:
            closed.append(True)

    seen._coil = Remote()
    seen.close()
    assert closed == [True]
    camera(SimpleNamespace(relaxes=False)).close()


def test_a_camera_without_a_frame_rate_takes_ten_frames_per_second_and_draws_a_still_beam_once() -> None:
    corners = np.array([[0.0, -1.5], [30.0, -1.5], [30.0, 1.5], [0.0, 1.5]])
    drawn: list[float] = []

    def outlines(field_mT: float) -> tuple[np.ndarray, None]:
        drawn.append(field_mT)
        return corners, None

    beam = SimpleNamespace(relaxes=False, moves=lambda field: not drawn, outlines_mm=outlines)
    seen = camera(beam)
    first, second = seen.grab(1.0), seen.grab(1.0)
    assert (first.number, second.number) == (1, 2)
    assert second.timestamp_s - first.timestamp_s == pytest.approx(0.1)
    assert drawn == [pytest.approx(1.2)]  # of the coil alone
    seen.flush()
    assert seen.grab(1.0).number == 3
    free = camera(beam, frame_rate_Hz=50.0)
    assert free.settings.frame_rate_Hz == 50.0
    one = free.grab(1.0)
    free._clock.sleep(0.1)
    two = free.grab(1.0)
    assert two.timestamp_s - one.timestamp_s == pytest.approx(0.02)  # from the buffer
    free.flush()
    later = free.grab(1.0)
    assert later.number - two.number == 5
    assert later.timestamp_s - two.timestamp_s == pytest.approx(5 * 0.02)


@pytest.mark.parametrize(
    ("axis_deg", "farthest_mm"), [(90.0, (21.0, 33.0)), (0.0, (33.0, 21.0)), (-90.0, (21.0, 3.0)), (180.0, (3.0, 21.0))]
)
def test_the_frames_of_a_real_rig_show_the_beam_in_every_direction(
    axis_deg: float, farthest_mm: tuple[float, float]
) -> None:
    # The frames show 0.7 lengths of 30 mm on both sides, 0.1 behind the clamp, and 0.1 beyond the tip.
    rig = load_rig("virtual")
    calibration = rig.calibration.model_copy(
        update={"pixels_per_mm": 10.0, "clamp_midpoint_px": (400.0, 400.0), "axis_angle_deg": axis_deg}
    )
    specimen = load_specimen("type1")
    assert specimen.specimen.length_mm == 30.0
    shown = with_virtual_table(rig.model_copy(update={"virtual": None, "calibration": calibration}), specimen).virtual
    assert shown is not None
    assert shown.frame_size_px == tuple(16 * math.ceil((400.0 + 10.0 * mm - 1e-6) / 16) for mm in farthest_mm)


def test_the_loads_of_the_virtual_beam_have_the_background_field() -> None:
    loads = VirtualLoads(20.0, 70.0, (1e-3, -2e-3)).at([0.0, 4.0])
    field = np.asarray(loads.field_T)
    direction = np.array([math.cos(math.radians(70.0)), math.sin(math.radians(70.0))])
    assert field[1] - field[0] == pytest.approx(4e-3 * direction)
    assert np.asarray(loads.gravity)[0] == pytest.approx(
        9.80665 * np.array([math.cos(math.radians(20.0)), math.sin(math.radians(20.0))])
    )
    assert len(VirtualLoads(None, 70.0).at([1.0])) == 1


@pytest.mark.parametrize("series", [((), ()), ((0.2,), (1.5,))])
def test_the_moving_beam_of_a_material_has_its_series_or_the_assumed_losses(series: tuple[Any, Any]) -> None:
    material = TrueMaterial(model="neo-hookean", parameters={"mu_Pa": 40e3}, prony_h=series[0], prony_tau_s=series[1])
    virtual = VirtualBeam(BEAM, material, (6, 1, 1), VirtualLoads(0.0, 90.0, (1e-3, 0.0)), 6.0)
    assert virtual.relaxes is bool(series[0])
    moving = virtual.moving()
    assert (moving._viscosity_s == 0.0) is bool(series[0])
    assert LOSS_FACTOR == 0.1
    assert moving._rates.tolist() == [1.0 / tau for tau in series[1]]
    assert moving._shares == pytest.approx(series[0])
    assert moving._elastic[0] == pytest.approx(40e3 * moving.rod.stiffness[0])
    field, gravity = moving._loads(5.0)
    assert field == pytest.approx([1e-3, 5e-3])
    assert gravity == pytest.approx([9.80665, 0.0])
