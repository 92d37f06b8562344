"""The simulated rod, moving beam, optics and bench give the numbers stored from an earlier version."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_fitting import Loads, Magnet, Specimen
from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.laws.prony import Prony
from eimi_lab.config.rig import Rig, load_rig
from eimi_lab.config.sensor import RigSensor
from eimi_lab.config.simulated_optics import Optics
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.process.errors import InputError
from eimi_lab.virtual.client_rig import with_virtual_table, write_client_rig
from eimi_lab.virtual.moving_beam import MovingBeam
from eimi_lab.virtual.moving_outlines import MovingOutlines
from eimi_lab.virtual.optics import expose, make_scene, render
from eimi_lab.virtual.rod import Rod, Stiffness, stiffness_of_solid
from eimi_lab.virtual.served_bench import pictures
from eimi_lab.virtual.simulation import keys_of, parse_parameters, simulate, write_simulation
from eimi_lab.virtual.virtual_rig import open_virtual_coil, open_virtual_rig, true_field_mT, truth_of
from eimi_lab.virtual.virtual_sensors import emulated_instrument, open_virtual_sensor
from tests.shared.accepted_numbers import check, described

ACCEPTED = Path(__file__).parent / "virtual"
MAGNET = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0, magnetisation_angle_deg=4.0)
WITH_MAGNET = Specimen(30.0, 3.0, 5.0, 1070.0, section="solid", magnet=MAGNET)
MAGNETISED = Specimen(30.0, 2.0, 5.0, 1500.0, section="plane-stress", magnetisation_A_per_m=(20e3, 5e3))
STIFFNESS = Stiffness(0.0251, 4.0e-10, 2.0e-6, -3.0)
FREE = Stiffness(0.0296, math.inf, 1.0e-6, -2.5)
MODULUS_PA = 50e3
SERIES = Prony(np.array([0.2, 0.1]), np.array([0.05, 1.0]))


def rods() -> Iterator[tuple[str, Rod]]:
    yield "with a magnet", Rod(WITH_MAGNET, STIFFNESS)
    yield "magnetised", Rod(MAGNETISED, FREE)


def of_field(field_mT: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([1e-3, 1e-3 * field_mT]), np.array([9.8, 0.5])


def moving(specimen: Specimen = WITH_MAGNET, series: Prony | None = None, loss: float = 0.0) -> MovingBeam:
    stiffness = STIFFNESS if specimen is WITH_MAGNET else FREE
    return MovingBeam(specimen, stiffness, MODULUS_PA, series, of_field, loss)


def test_the_rod_has_the_accepted_numbers(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    lines: list[str] = []
    for name, rod in rods():
        z, speed = 0.3 * rng.standard_normal((2, rod.size))
        derivatives, remaining = rod.moved(z, speed)
        along, across = np.array([0.0, 0.02, 0.4, 1.0, 1.1]), np.array([0.0, 1.0, -1.0, 0.5, 1.5])
        parts = {
            "size": rod.size,
            "stiffness": rod.stiffness[np.isfinite(rod.stiffness)],
            "derivatives": derivatives,
            "remaining": remaining,
            "strain": rod.strain(z),
            "rate": rod.strain_rate(z, speed),
            "mass": 1e9 * rod.mass(derivatives),
            "loads": 1e6 * rod.loads(z, derivatives, remaining, np.array([2e-3, 5e-3]), np.array([9.8, 1.0])),
            "places": rod.places_mm(np.stack([z, 0.5 * z]), along, across),
            "end": rod.end,
        }
        lines += described(parts, name)
    check(lines, ACCEPTED / "rod.txt", tmp_path)


def test_the_derivatives_of_the_rod_are_those_of_its_places() -> None:
    rng = np.random.default_rng(6)
    for _, rod in rods():
        z, speed = 0.3 * rng.standard_normal((2, rod.size))
        gauss = (0.5 * (np.polynomial.legendre.leggauss(8)[0] + 1.0) * rod.length + rod._flexible - rod.length) / (
            rod._flexible
        )

        def places(at: np.ndarray, rod: Rod = rod, gauss: np.ndarray = gauss) -> np.ndarray:
            return 1e-3 * rod.places_mm(at, gauss, np.zeros(8)).T

        derivatives, remaining = rod.moved(z, speed)
        step = 1e-4
        for k in range(rod.size):
            more = step * np.eye(rod.size)[k]
            slope = (places(z + more) - places(z - more)) / (2 * step)
            assert derivatives[:, :8, k] == pytest.approx(slope, abs=1e-8)
        second = (places(z + step * speed) - 2 * places(z) + places(z - step * speed)) / step**2
        assert remaining[:, :8] == pytest.approx(second, abs=1e-6)


def test_the_forces_of_the_rod_are_the_gradient_of_its_energy() -> None:
    rng = np.random.default_rng(7)
    field, gravity = np.array([2e-3, 5e-3]), np.array([9.8, 1.0])
    for specimen, rod in ((WITH_MAGNET, Rod(WITH_MAGNET, STIFFNESS)), (MAGNETISED, Rod(MAGNETISED, FREE))):
        z = 0.2 * rng.standard_normal(rod.size)
        still = np.zeros(rod.size)
        derivatives, remaining = rod.moved(z, still)
        force = rod.loads(z, derivatives, remaining, field, gravity)
        without = rod.loads(z, derivatives, remaining, field, np.zeros(2))
        heavy = force - without
        assert heavy == pytest.approx(np.einsum("x,p,xpk->k", gravity, rod._masses, derivatives), rel=1e-9)
        step = 1e-5

        def energy(at: np.ndarray, specimen: Specimen = specimen, rod: Rod = rod) -> float:
            if specimen.magnet:
                angle = rod.end @ at + math.radians(4.0)
                return -MAGNET.moment_A_m2 * float(np.array([math.cos(angle), math.sin(angle)]) @ field)
            weights, magnetisation = rod.torques
            turn = rod.angle @ at
            along = magnetisation[0] * np.cos(turn) - magnetisation[1] * np.sin(turn)
            across = magnetisation[0] * np.sin(turn) + magnetisation[1] * np.cos(turn)
            return -float(weights @ (along * field[0] + across * field[1]))

        slope = [(energy(z + step * e) - energy(z - step * e)) / (2 * step) for e in np.eye(rod.size)]
        assert without == pytest.approx(-np.array(slope), rel=1e-5, abs=1e-12)


def test_the_stiffness_of_a_rod_is_that_of_its_solid(tmp_path: Path) -> None:
    lines: list[str] = []
    for name, specimen, law, values in (
        ("magnet", WITH_MAGNET, "neo-hookean", (MODULUS_PA,)),
        ("plain", Specimen(30.0, 2.0, 5.0, 1070.0, section="solid"), "yeoh", (25e3, 1e3, 10.0)),
    ):
        found = stiffness_of_solid(specimen, law, values, (6, 1, 1))
        lines += described({"length": 1e3 * found.length_m, "hinge": 1e9 * found.hinge_m3}, name)
        lines += described({"softening": 1e6 * found.softening_m2, "by strain": found.by_strain}, name)
    check(lines, ACCEPTED / "stiffness.txt", tmp_path)


def test_the_moving_beam_has_the_accepted_numbers(tmp_path: Path) -> None:
    times = np.array([0.005, 0.02, 0.1, 0.3])
    lines: list[str] = []
    for name, beam in {
        "elastic": moving(),
        "lossy": moving(loss=0.1),
        "creeping": moving(series=SERIES),
        "magnetised": moving(MAGNETISED, loss=0.2),
    }.items():
        lines += described(beam.at_rest(6.0), f"{name} at rest")
        beam.start(0.0, 1.0)
        lines += described(beam.advance(0.0, lambda time_s: 5.0 * min(time_s / 0.01, 1.0), times), f"{name} moves")
        lines += described([beam.time_s, beam._step_s, beam._fastest, beam._viscosity_s], f"{name} steps")
        lines += described(beam.advance(0.31, lambda _: 5.0), f"{name} further")
    check(lines, ACCEPTED / "moving_beam.txt", tmp_path)


def test_a_beam_at_rest_stays_and_a_moved_one_returns_to_rest() -> None:
    beam = moving(loss=0.4)
    rest = beam.at_rest(3.0)
    beam.start(2.0, 3.0)
    assert beam.advance(2.2, lambda _: 3.0)[0] == pytest.approx(rest, abs=1e-6)
    assert beam.time_s == pytest.approx(2.2)
    moved = beam.advance(6.0, lambda _: 4.0)[0]
    assert moved == pytest.approx(beam.at_rest(4.0), abs=2e-4)
    assert abs(moved[0] - rest[0]) > 0.01
    late = moving()
    assert late.advance(1.0, lambda _: 2.0)[0] == pytest.approx(late.at_rest(2.0))  # starts at rest at the first time


def test_the_moving_outline_is_that_of_the_solid_at_rest() -> None:
    # For another shape of the rod, the outline moves with the rod.
    beam = moving()
    along = np.linspace(0.0, 30.0, 13)

    def outlines(field_mT: float) -> tuple[np.ndarray, np.ndarray]:
        turn = 0.05 * field_mT * along / 30.0
        left, right = (np.column_stack([along, 15.0 * turn + side]) for side in (-1.5, 1.5))
        corners = np.array([[26.0, -1.5], [30.0, -1.5], [30.0, 1.5], [26.0, 1.5]])
        return np.concatenate([left, right[::-1]]), corners + np.array([0.0, 0.5 * field_mT])

    shapes = MovingOutlines(outlines, beam, WITH_MAGNET, 6.0)
    for field_mT in (-4.5, 0.0, 3.0):
        rest = beam.at_rest(field_mT)
        found, magnet = shapes.at(rest)
        assert found == pytest.approx(outlines(field_mT)[0], abs=2e-3)
        assert magnet == pytest.approx(outlines(field_mT)[1], abs=2e-3)
    rest = beam.at_rest(2.0)
    stretched = rest.copy()
    stretched[4] += 0.01  # the mean strain
    grown = shapes.at(stretched)[0] - shapes.at(rest)[0]
    assert grown[12] == pytest.approx(grown[13], abs=0.02)  # the two corners of the tip
    assert 0.2 < grown[12, 0] < 0.3
    assert np.abs(grown[[0, -1]]).max() < 1e-6
    bare = MovingOutlines(lambda field: (outlines(field)[0], None), moving(MAGNETISED), MAGNETISED, 6.0)
    assert bare.at(moving(MAGNETISED).at_rest(1.0))[1] is None


OPTICS = Optics(blur_px=1.1, gradient=0.3, vignette=0.2, lumps=0.05, silicone_transmission=0.2)
BEAM_PX = np.array([[20.3, 5.0], [32.8, 5.0], [33.9, 40.2], [21.1, 41.0]])
MAGNET_PX = np.array([[22.0, 30.0], [32.0, 30.0], [32.3, 39.0], [22.2, 39.0]])
CLAMP_PX = np.array([[5.0, -1.0], [50.0, -1.0], [50.0, 8.5], [5.0, 8.5]])


def test_rendered_scenes_have_the_accepted_numbers(tmp_path: Path) -> None:
    size = (56, 48)
    scenes = {
        "all": make_scene(OPTICS, size, BEAM_PX, MAGNET_PX, CLAMP_PX),
        "fine": make_scene(OPTICS, size, BEAM_PX, MAGNET_PX, CLAMP_PX, 2),
        "beam": make_scene(replace(OPTICS, blur_px=0.0, bits=12, gamma=2.2), size, BEAM_PX),
        "even": make_scene(replace(OPTICS, lumps=0.0, gradient=0.0, vignette=0.0), size, BEAM_PX, MAGNET_PX),
    }
    lines: list[str] = []
    for name, scene in scenes.items():
        lines += described(scene, name)
        lines += described(expose(scene, np.random.default_rng(3)), f"{name} exposed")
    drawn = render(OPTICS, size, np.random.default_rng(3), BEAM_PX, MAGNET_PX, CLAMP_PX)
    assert np.array_equal(drawn, expose(scenes["all"], np.random.default_rng(3)))
    check(lines, ACCEPTED / "optics.txt", tmp_path)


def test_the_light_of_a_scene_follows_from_its_transmissions() -> None:
    # Far from all borders, the grey value is the back-light times the transmission of what is in front of it.
    plain = Optics(blur_px=0.0, gradient=0.0, vignette=0.0, lumps=0.0, silicone_transmission=0.3, background=0.8)
    scene = make_scene(plain, (56, 48), BEAM_PX, MAGNET_PX, CLAMP_PX)
    assert scene.mean[45, 45] == pytest.approx(0.8 * 255.0)
    assert scene.mean[20, 27] == pytest.approx(0.3 * 0.8 * 255.0, rel=1e-5)
    assert scene.mean[35, 27] == pytest.approx(plain.magnet_transmission * 0.8 * 255.0, abs=1e-3)
    assert scene.mean[3, 27] == pytest.approx(plain.clamp_transmission * 0.8 * 255.0, abs=1e-3)
    assert scene.deviation[20, 27] == pytest.approx(255.0 * math.sqrt(0.24 / plain.full_well_e), rel=1e-5)
    assert (scene.bits, scene.gamma) == (8, 1.0)
    clipped = expose(replace(scene, mean=np.full((4, 4), 300.0, np.float32), deviation=np.zeros((4, 4), np.float32)),
                     np.random.default_rng(0))  # fmt: skip
    assert (clipped == 255).all()
    rounded = expose(replace(scene, mean=np.full((4, 4), 99.6, np.float32), deviation=np.zeros((4, 4), np.float32)),
                     np.random.default_rng(0))  # fmt: skip
    assert (rounded == 100).all()


def planar() -> SpecimenFile:
    return parse(SpecimenFile, load_specimen("type1").text.replace('"solid"', '"plane-stress"'), "type1")


@pytest.mark.parametrize("section", ["plane", "solid"])
def test_a_simulation_has_the_accepted_numbers(section: str, tmp_path: Path) -> None:
    law, values = parse_parameters("mooney-rivlin", ["C10_Pa=15000", "C01_Pa=9000"])
    assert keys_of(law) == ["C10_Pa", "C01_Pa"]
    specimen = planar() if section == "plane" else load_specimen("type1")
    drawn = values * np.random.default_rng(1).normal(1.0, 0.05, (12, 2)) if section == "plane" else None
    field = np.array([0.0, 2.0, 4.0])
    result = simulate(specimen, law, values, field, 20.0, 80.0, drawn=drawn)
    lines = list(
        described([result.edges_mm, result.tip_mm, result.tip_angle_deg, result.max_stretch, result.tips], section)
    )
    figure = result.plot()
    axes = figure.axes[0]
    for collection in axes.collections:
        paths = np.array([path.vertices for path in collection.get_paths()])
        lines += described([paths, np.asarray(collection.get_array()), collection.get_clim()], f"{section} patches")
    lines += [
        line
        for number, drawn_line in enumerate(axes.lines)
        for line in described(drawn_line.get_xydata(), f"{section} line {number}")
    ]
    lines += [
        f"{section}: {axes.get_xlabel()}, {axes.get_ylabel()}, {axes.get_aspect()}",
        *result._repr_html_().splitlines(),
        repr(result),
    ]
    check(lines, ACCEPTED / f"simulation_{section}.txt", tmp_path)


def small_rig(**of_rig: Any) -> Rig:
    # Return the program's own virtual rig with a coarse mesh and small frames.
    shipped = load_rig("virtual")
    assert shipped.virtual is not None
    bench = {"coil_constant_mT_per_A": 5.0, "background_field_mT": (0.1, 0.2), "cast_bend_mm": 0.2, "taper_mm": 0.1,
             "magnetisation_angle_deg": 3.0}  # fmt: skip
    materials = shipped.virtual.materials
    given = type(materials).model_validate({**materials.model_dump(exclude_none=True), "bench": bench})
    virtual = shipped.virtual.model_copy(
        update={"seed": 3, "mesh": (6, 1, 1), "frame_size_px": (160, 128), "materials": given}
    )
    scale = {"pixels_per_mm": 3.0, "clamp_midpoint_px": (80.0, 16.0), "gravity_angle_deg": 80.0}
    return shipped.model_copy(
        update={"virtual": virtual, "calibration": shipped.calibration.model_copy(update=scale), **of_rig}
    )


@pytest.mark.parametrize("rate_Hz", [None, 50.0])
def test_the_frames_of_the_virtual_bench_have_the_accepted_numbers(rate_Hz: float | None, tmp_path: Path) -> None:
    rig = small_rig()
    rig = rig.model_copy(update={"camera": rig.camera.model_copy(update={"frame_rate_Hz": rate_Hz})})
    specimen = load_specimen("type1")
    supply, camera, clock, truth = open_virtual_rig(rig, specimen)
    supply.set_voltage(30.0)
    supply.set_output(True)
    lines = list(described(truth, "truth"))
    lines += described(camera.identify(), "identity")
    name = f"at {rate_Hz} Hz"
    for step, current_A in enumerate((0.0, 0.4, 0.4)):
        supply.set_current(current_A)
        clock.sleep(0.15)
        if step == 2:
            camera.swap_leads()
            camera.flush()
        frame = camera.grab(1.0)
        lines += described([frame.image, frame.number, frame.timestamp_s, camera.field_mT()], f"{name} {step}")
    camera.close()
    check(lines, ACCEPTED / f"bench_{'free' if rate_Hz else 'asked'}.txt", tmp_path)


def test_the_true_field_is_that_of_the_coil_and_the_background() -> None:
    rig = small_rig()
    supply, field_mT, clock = open_virtual_coil(rig)
    assert field_mT() == pytest.approx(0.1, abs=0.11)
    without = field_mT()
    supply.set_voltage(30.0)
    supply.set_output(True)
    supply.set_current(0.3)
    clock.sleep(30.0)
    assert field_mT() - without == pytest.approx(5.0 * 0.3, abs=0.02)
    assert true_field_mT(rig, SimpleNamespace(coil_current_A=lambda: -0.2))() - without == pytest.approx(-1.0, abs=0.02)
    assert truth_of(rig, load_specimen("type1"))["bench"]["cast_bend_mm"] == 0.2
    with pytest.raises(InputError, match=r"has no \[virtual\] table"):
        truth_of(rig.model_copy(update={"virtual": None}), load_specimen("type1"))


def sensor(**changed: Any) -> RigSensor:
    values = {"name": "hall", "driver": "lakeshore-425", "address": "virtual", "measures": "field"}
    return RigSensor.model_validate({**values, **changed})


def test_an_emulated_sensor_reads_the_field_at_its_place_or_the_temperature_of_the_room() -> None:
    clock = SimulatedClock()
    hall = open_virtual_sensor(sensor(at_magnet=1.25), lambda: 5.0, clock)
    readings = [hall.read().value for _ in range(200)]
    assert np.mean(readings) == pytest.approx(4.0, abs=0.01)  # the field at the probe
    assert 0.003 < np.std(readings) < 0.008
    assert emulated_instrument(sensor(), lambda: 5.0, clock) is not None


def test_a_served_picture_begins_at_the_corner_of_the_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    # Rows above and columns left of the region are black, and pictures of more bits are reduced to 8 bits.
    from eimi_lab.virtual import served_bench

    image = np.arange(12, dtype=np.uint16).reshape(3, 4) * 256
    taken = []
    camera = SimpleNamespace(grab=lambda timeout_s: taken.append(timeout_s) or SimpleNamespace(image=image))
    given: list[Any] = []
    monkeypatch.setattr(served_bench, "virtual_camera", lambda *arguments: given.extend(arguments) or camera)
    monkeypatch.setattr(served_bench, "RemoteCoil", lambda line: line)
    rig = small_rig()
    optics = replace(rig.virtual.optics, bits=12)
    rig = rig.model_copy(
        update={
            "virtual": rig.virtual.model_copy(update={"optics": optics}),
            "camera": rig.camera.model_copy(update={"region": (2, 1, 4, 3)}),
        }
    )
    rig = rig.model_copy(update={"camera": rig.camera.model_copy(update={"frame_rate_Hz": 50.0})})
    specimen = load_specimen("type1")
    shown = pictures(rig, specimen, "line")()
    of_rig, of_specimen, coil, clock = given
    assert of_rig.camera.frame_rate_Hz is None
    assert (of_rig.supply, of_specimen, coil) == (rig.supply, specimen, "line")
    assert isinstance(clock, WallClock)
    assert len(taken) == 2  # the first one before the camera is served
    assert shown.dtype == np.uint8
    assert shown.shape == (4, 6)
    assert shown[1:, 2:].tolist() == (image >> 4).astype(np.uint8).tolist()
    assert not shown[0].any()
    assert not shown[:, :2].any()
    whole = rig.model_copy(update={"camera": rig.camera.model_copy(update={"region": None})})
    assert pictures(whole, specimen, "line")().shape == (3, 4)


def test_the_files_of_a_simulation_have_every_state(tmp_path: Path) -> None:
    law, values = parse_parameters("neo-hookean", ["mu_Pa=46390"])
    result = simulate(planar(), law, values, np.array([0.0, 3.0]), 0.0, drawn=np.array([[45e3], [48e3], [47e3]]))
    write_simulation(tmp_path, result)
    tip = np.genfromtxt(tmp_path / "tip.csv", delimiter=",", names=True)
    assert tip.dtype.names == (
        *("field_mT", "x_mm", "y_mm", "angle_deg", "max_stretch"),
        *("x_low_mm", "x_high_mm", "y_low_mm", "y_high_mm", "angle_low_deg", "angle_high_deg"),
    )
    assert (tip["angle_low_deg"] <= tip["angle_high_deg"]).all()
    assert tip["angle_low_deg"][1] < tip["angle_deg"][1] < tip["angle_high_deg"][1]
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["shapes.png", "state_00.vtu", "state_00_left.csv", "state_00_right.csv", "state_01.vtu",
                     "state_01_left.csv", "state_01_right.csv", "tip.csv"]  # fmt: skip


def test_the_client_rig_shows_the_beam_with_a_margin(tmp_path: Path) -> None:
    # Without a region of the camera, the frames show 0.7 lengths on both sides of the beam and 0.1 beyond its tip.
    rig = load_rig("virtual")
    calibration = rig.calibration.model_copy(
        update={"pixels_per_mm": 10.0, "clamp_midpoint_px": (250.0, 40.0), "axis_angle_deg": 90.0}
    )
    real = rig.model_copy(update={"virtual": None, "calibration": calibration})
    shown = with_virtual_table(real, load_specimen("type1")).virtual
    length = load_specimen("type1").specimen.length_mm
    assert shown is not None
    expected = (250.0 + 7.0 * length, 40.0 + 11.0 * length)
    assert shown.frame_size_px == tuple(16 * math.ceil(value / 16) for value in expected)
    assert with_virtual_table(rig, load_specimen("type1")) is rig
    write_client_rig(rig, tmp_path / "a.toml", "x", "y", {}, False)
    with pytest.raises(InputError):
        write_client_rig(rig, tmp_path / "a.toml", "x", "y", {}, False)


def test_the_solid_of_the_virtual_beam_is_the_solid_of_a_fit() -> None:
    from eimi_lab.virtual.beam import VirtualBeam, VirtualLoads

    rig = load_rig("virtual")
    material = rig.virtual.materials.silicone["Dragon Skin 10"]
    loads = VirtualLoads(0.0, 90.0)
    beam = VirtualBeam(WITH_MAGNET, material, (6, 1, 1), loads, 6.0)
    assert beam.moves(0.0)
    outline, magnet = beam.outlines_mm(3.0)
    assert not beam.moves(3.0)
    assert not beam.moves(3.0 + 4e-5)
    assert beam.moves(3.0 - 6e-5)
    assert beam.relaxes == bool(material.prony_h)
    model = SolidBeside(WITH_MAGNET, 6, 1, 1)
    from eimi_fitting.laws import LAWS

    shapes = model.solve(LAWS[material.model], np.array([material.values]), Loads.along([3.0], 90.0, 0.0))
    corners = np.array([[26.0, -1.5, 0.0], [30.0, -1.5, 0.0], [30.0, 1.5, 0.0], [26.0, 1.5, 0.0]])
    assert magnet == pytest.approx(model.positions(shapes, corners)[0, 0, :, :2], abs=0.02)
    half = len(outline) // 2
    assert outline[[half - 1, half]] == pytest.approx(magnet[[1, 2]], abs=0.05)
    assert outline[[0, -1]] == pytest.approx(np.array([[0.0, -1.5], [0.0, 1.5]]), abs=1e-3)
