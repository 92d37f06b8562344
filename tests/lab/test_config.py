"""The TOML files of the program are valid; a mistake in a TOML file gives an error of one line."""

from __future__ import annotations

from decimal import Decimal
from importlib.resources import files as package_files
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eimi_fitting.beam.specimen import VACUUM_PERMEABILITY
from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.config.materials import TrueMaterial, load_materials
from eimi_lab.config.people import People
from eimi_lab.config.protocol import Protocol, SupplyLimits, load_protocol
from eimi_lab.config.rig import Rig, load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import Document, parse, parse_table, table_text
from eimi_lab.process.errors import InputError

SHIPPED = Path(str(package_files("eimi_lab.protocols")))


def test_currents_of_the_shipped_protocols_are_exact_decimals() -> None:
    dragon_skin = load_protocol("dragon_skin_10")
    ecoflex = load_protocol("ecoflex_00_50")
    assert [str(current) for current in dragon_skin.currents_A] == [f"{k // 10}.{k % 10}" for k in range(16)]
    assert [str(current) for current in ecoflex.currents_A] == [f"{k // 10}.{k % 10}" for k in range(11)]


@given(start=st.integers(-200, 200), steps=st.integers(1, 60), step=st.integers(1, 50), down=st.booleans())
def test_set_points_have_no_rounding_error(start: int, steps: int, step: int, down: bool) -> None:
    stop = start - steps * step if down else start + steps * step
    text = load_protocol("dragon_skin_10").text
    text = text.replace("start_A = 0.0", f"start_A = {start / 100}").replace("stop_A = 1.5", f"stop_A = {stop / 100}")
    text = text.replace("step_A = 0.1", f"step_A = {step / 100}").replace("current_A = 1.6", "current_A = 1000.0")
    currents = parse(Protocol, text, "p.toml").currents_A
    expected = [Decimal(start + (-1 if down else 1) * k * step) / 100 for k in range(steps + 1)]
    assert [Decimal(repr(current)) for current in currents] == expected


def test_the_stricter_of_two_limits_is_the_smaller_current_and_the_smaller_voltage() -> None:
    one, other = SupplyLimits(current_A=1.0, voltage_V=20.0), SupplyLimits(current_A=2.0, voltage_V=5.0)
    for limits in (one.stricter(other), other.stricter(one)):
        assert (limits.current_A, limits.voltage_V) == (1.0, 5.0)


def test_up_and_down_passes_every_current_once_more_on_the_way_back() -> None:
    text = load_protocol("dragon_skin_10").text.replace("stop_A = 1.5", "stop_A = 0.3\nup_and_down = true")
    assert parse(Protocol, text, "p.toml").currents_A == (0.0, 0.1, 0.2, 0.3, 0.2, 0.1, 0.0)


def test_a_prony_series_of_a_hidden_material_needs_two_lists_of_equal_length() -> None:
    relaxing = TrueMaterial(
        model="neo-hookean", parameters={"mu_Pa": 46390.0}, prony_h=(0.1,), prony_tau_s=(2.0,)
    ).series
    assert relaxing is not None
    assert relaxing.long_term == pytest.approx(1 / 1.1)
    wrong: tuple[tuple[float, ...], ...] = ((), (2.0, 3.0), (0.0,))
    for taus in wrong:
        with pytest.raises(ValueError, match="two lists of equal length"):
            TrueMaterial(model="neo-hookean", parameters={"mu_Pa": 46390.0}, prony_h=(0.1,), prony_tau_s=taus)


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("specimens/*.toml")), ids=lambda path: path.stem)
def test_shipped_specimens_load_by_name(path: Path) -> None:
    specimen = load_specimen(path.stem)
    assert specimen == load_specimen(path)
    assert specimen.specimen.name == path.stem
    assert specimen.mechanics().magnet is not None


def test_shipped_rigs_load_by_name_with_their_calibration() -> None:
    virtual, bench = load_rig("virtual"), load_rig("bench_example")
    assert virtual.virtual is not None
    assert bench.virtual is None
    assert virtual.calibration.coil_constant_mT_per_A == bench.calibration.coil_constant_mT_per_A == 4.7
    assert set(virtual.virtual.materials.silicone) == {"Dragon Skin 10", "Dragon Skin 10, relaxing", "Ecoflex 00-50"}


def test_the_calibration_of_a_rig_is_read_from_the_folder_of_the_rig_file(files: Path) -> None:
    text = load_rig("bench_example").text.replace("bench_example_calibration.toml", "calibration.toml")
    (files / "rig.toml").write_text(text)
    assert load_rig(files / "rig.toml").calibration.pixels_per_mm == 8.0
    (files / "calibration.toml").unlink()
    with pytest.raises(InputError, match=r"rig\.toml: calibration = 'calibration\.toml': there is no such file"):
        load_rig(files / "rig.toml")


def test_the_finite_element_specimen_has_the_moment_of_the_magnet() -> None:
    specimen = load_specimen("type1")
    magnet = specimen.magnet
    assert magnet is not None
    mechanics = specimen.mechanics()
    assert mechanics.magnet is not None
    volume_m3 = magnet.length_mm * magnet.width_mm * magnet.depth_mm * 1e-9
    assert mechanics.magnet.moment_A_m2 == pytest.approx(magnet.remanence_T / VACUUM_PERMEABILITY * volume_m3)
    assert mechanics.flexible_length_mm == specimen.specimen.length_mm - magnet.length_mm


def test_magnetised_silicone_and_a_magnet_before_the_tip_reach_the_finite_element_specimen() -> None:
    text = load_specimen("type1").text.replace("section", "magnetisation_kA_per_m = [40, -2.5]\nsection", 1)
    mechanics = parse(SpecimenFile, text.replace("[magnet]", "[magnet]\ntip_offset_mm = 1.5"), "a.toml").mechanics()
    assert mechanics.magnetisation_A_per_m == (40e3, -2.5e3)
    assert mechanics.flexible_length_mm == 24.5


def test_the_specimen_of_the_real_beam_loads(measured: Path) -> None:
    mechanics = load_specimen(measured / "real_beam" / "specimen.toml").mechanics()
    assert (mechanics.length_mm, mechanics.section, mechanics.tip_load_mm) == (100.0, "plane-stress", (100.0, 15.0))


@pytest.mark.parametrize(
    ("table", "point"), [("", (30.0, 0.0)), ("y_mm = 1.0", (30.0, 1.0)), ("x_mm = 28", (28.0, 0.0))]
)
def test_a_tip_load_without_a_position_along_the_beam_is_at_the_tip(table: str, point: tuple[float, float]) -> None:
    text = load_specimen("type1").text.replace("[magnet]", f"[tip_load]\n{table}\n[magnet]")
    assert parse(SpecimenFile, text, "a.toml").mechanics().tip_load_mm == point


def test_the_object_of_a_file_keeps_the_text_of_the_file(files: Path) -> None:
    path = files / "specimen.toml"
    assert load_specimen(path).text == path.read_text()


def test_any_character_of_a_name_is_read_back_from_written_text() -> None:
    table = {"name": 'µ "ø" \\ 😀 \u2028', "controls": "".join(map(chr, [*range(32), 0x7F, 0x85])), "list": ["😀"]}
    assert parse_table(table_text(table), "a.toml") == table


def refuse(model: type[Document], shipped: Document, old: str, new: str) -> str:
    text = shipped.text
    assert old in text
    with pytest.raises(InputError) as caught:
        parse(model, text.replace(old, new, 1), "some.toml")
    message = str(caught.value)
    assert message.startswith("some.toml: ")
    assert "\n" not in message
    return message.removeprefix("some.toml: ")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("length_mm", "lenght_mm", "specimen.lenght_mm is not a known key; did you mean length_mm?"),
        ("length_mm", "length_cm", "specimen.length_cm is not a known key; did you mean length_mm?"),
        ("[magnet]", "[magnt]", "magnt is not a known key; did you mean magnet?"),
        ("length_mm = 30.0", "length_mm = -30.0", "specimen.length_mm = -30.0 should be greater than 0"),
        ("width_mm = 3.0", "width_mm = 0.003", "specimen.width_mm = 0.003 should be 0.05 mm or more; if"),
        ("length_mm = 30.0", 'length_mm = "30"', "specimen.length_mm = '30' should be a valid number"),
        ("length_mm = 30.0", "length_mm = true", "specimen.length_mm = true should be a valid number"),
        ("length_mm = 30.0", "length_mm = inf", "specimen.length_mm = inf should be a finite number"),
        ("length_mm = 30.0", "length_mm = 3.5", None),
        ("length_mm = 30.0", "length_mm = 4.0", "magnet.length_mm = 4 should be less than specimen.length_mm = 4"),
        ("width_mm = 3.0", "width_mm = 2.0", "magnet.width_mm = 3 should be at most specimen.width_mm = 2"),
        ("depth_mm = 5.0", "depth_mm = 1.0", "magnet.depth_mm = 2 should be at most specimen.depth_mm = 1"),
        ('"solid"', '"plane"', "specimen.section = 'plane' should be 'solid', 'plane-strain' or 'plane-stress'"),
        ("density_kg_m3", "# density_kg_m3", "specimen.density_kg_m3 is missing"),
        ("[specimen]", "[specimen", None),
        ("[magnet]", "[magnet]\ntip_offset_mm = -1.0", "magnet.tip_offset_mm = -1.0 should be greater than or equal"),
        (
            "[magnet]",
            "[magnet]\ntip_offset_mm = 26.0",
            "magnet.tip_offset_mm = 26 and magnet.length_mm = 4 together should",
        ),
        (
            "section",
            "magnetisation_kA_per_m = [40.0]\nsection",
            "specimen.magnetisation_kA_per_m should have more than 1 values",
        ),
        (
            "section",
            "magnetisation_kA_per_m = [1, 2, 3]\nsection",
            "specimen.magnetisation_kA_per_m = [1, 2, 3] should have at most 2 ",
        ),
        (
            "section",
            "magnetisation_kA_per_m = 40.0\nsection",
            "specimen.magnetisation_kA_per_m = 40.0 should be a list in square brackets",
        ),
        (
            "section",
            "magnetisation_kA_per_m = [1600.0, 50.0]\nsection",
            "specimen.magnetisation_kA_per_m = [1600, 50] has the magnitude 1600.78, which should be at most 1600",
        ),
        ("[magnet]", "[tip_load]\nx_mm = 31.0\ny_mm = 0.0\n[magnet]", "tip_load.x_mm = 31 should be on the beam"),
        ("[magnet]", "[tip_load]\nx_mm = 30.0\ny_mm = 2.0\n[magnet]", "tip_load.y_mm = 2 should be on the beam"),
    ],
)
def test_a_bad_specimen_is_refused_in_one_line(old: str, new: str, expected: str | None) -> None:
    message = refuse(SpecimenFile, load_specimen("type1"), old, new)
    assert expected is None or message.startswith(expected)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("step_A = 0.1 ", "step_A = 0.4 ", "[current] step_A = 0.4 does not divide the range from 0.0 to 1.5 A"),
        ("step_A = 0.1", "step_A = -0.1", "current.step_A = -0.1 should be greater than 0"),
        ("step_A = 0.1", "step_A = 1e-9", "[current] step_A = 1E-9 gives more than 1000 states"),
        ("stop_A = 1.5", "stop_A = 0.0", "[current] stop_A = 0.0 is equal to start_A"),
        ("stop_A = 1.5", "stop_A = 1.7", "current.stop_A goes to 1.7 A, which exceeds limits.current_A = 1.6"),
        ("start_A = 0.0", "start_A = -1.7", "current.start_A goes to -1.7 A, which exceeds limits.current_A = 1.6"),
        ("start_A = 0.0", "values_A = [0.0, 0.1]", "[current] should have either start_A, stop_A and step_A, or only"),
        ("[settle]", "[setle]", "setle is not a known key; did you mean settle?"),
        ("[ramp]", "[limits.ramp]", "limits.ramp is not a known key"),
        ("frames_per_state = 3", "frames_per_state = 0", "frames_per_state = 0 should be greater than or equal to 1"),
        ("timeout_s = 30.0", "timeout_s = 0.5", "[settle] timeout_s = 0.5 must be more than drift_window_s = 1"),
    ],
)
def test_a_bad_protocol_is_refused_in_one_line(old: str, new: str, expected: str) -> None:
    shipped = load_protocol("dragon_skin_10")
    padded = shipped.text.replace("step_A = 0.1\n", "step_A = 0.1 \n")
    assert refuse(Protocol, parse(Protocol, padded, "padded"), old, new).startswith(expected)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("field_angle_deg = 90.0", "field_angle_deg = 90 should be across the beam"),
        ("pixels_per_cm = 80.0", "pixels_per_cm is not a known key; did you mean pixels_per_mm?"),
        ("distortion = [0.0, 0.0, 0.0, 0.0]", "camera_matrix and distortion belong together"),
        (
            "camera_matrix = [[900, 0, 0], [0, 900, 0], [64, 48, 1]]\ndistortion = [0.0, 0.0, 0.0, 0.0]",
            "camera_matrix = [[900.0, 0.0, 0.0], [0.0, 900.0, 0.0], [64.0, 48.0, 1.0]] should be [[fx, skew, cx], [0,",
        ),
        ("clamp_midpoint_px = [64.0]", "clamp_midpoint_px should have more than 1 values"),
        ("telecentric = true\nstand_off_mm = 300.0", "stand_off_mm = 300 and telecentric = true exclude each other"),
        ("camera_tilt_deg = [1.0, 0.0]", "stand_off_mm is missing: camera_tilt_deg needs the distance"),
        ("[uncertainty]\ncamera_tilt_deg = 1.0", "stand_off_mm is missing: [uncertainty] camera_tilt_deg needs"),
    ],
)
def test_a_bad_calibration_is_refused_in_one_line(files: Path, line: str, expected: str) -> None:
    path = files / "calibration.toml"
    key = line.split(" = ")[0]
    kept = [other for other in path.read_text().splitlines() if not other.startswith(f"{key} ")]
    path.write_text("\n".join([*kept, line]))
    with pytest.raises(InputError) as caught:
        load_calibration(path)
    assert str(caught.value).startswith(f"{path}: {expected}")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            'driver = "virtual"',
            'driver = "kord"',
            "supply.driver = 'kord' is not a driver; the drivers are korad, scpi",
        ),
        (
            'driver = "virtual"',
            'driver = "korad"',
            "camera.source = 'virtual' should be the address that `eimi emulate`",
        ),
        (
            'address = "virtual"',
            'address = "spy:///dev/ttyUSB0?file=/home/me/.bashrc"',
            "supply.address = 'spy:///dev/ttyUSB0?file=/home/me/.bashrc' spy:// is not supported; give a port such as",
        ),
        ("blur_px", "blur_pixels", "virtual.optics.blur_pixels is not a known key; did you mean blur_px?"),
        ("virtual_materials", "butter", "materials = 'butter.toml': there is no such file in the folder"),
    ],
)
def test_a_bad_rig_is_refused_in_one_line(tmp_path: Path, old: str, new: str, expected: str) -> None:
    shipped = load_rig("virtual")
    assert shipped.virtual is not None
    (tmp_path / "virtual_calibration.toml").write_text(shipped.calibration.text)
    (tmp_path / "virtual_materials.toml").write_text(shipped.virtual.materials.text)
    path = tmp_path / "rig.toml"
    path.write_text(shipped.text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_rig(path)
    assert str(caught.value).startswith(f"{path}: {expected}")


@pytest.mark.parametrize(
    ("old", "new"), [("parameters = {", "parameters = { K_Pa = 1.0,"), ('model = "', 'model = "un')]
)
def test_a_bad_material_of_the_virtual_rig_is_refused_in_one_line(tmp_path: Path, old: str, new: str) -> None:
    shipped = load_rig("virtual").virtual
    assert shipped is not None
    path = tmp_path / "materials.toml"
    path.write_text(shipped.materials.text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_materials(path)
    assert str(caught.value).startswith(f"{path}: [silicone.Dragon Skin 10] ")


def test_the_text_of_a_rig_does_not_contain_the_true_materials() -> None:
    rig = load_rig("virtual")
    assert rig.virtual is not None
    for material in rig.virtual.materials.silicone.values():
        assert not any(f"{value:g}" in rig.text for value in material.values)


def test_an_unknown_name_is_refused_with_the_list_of_shipped_files() -> None:
    with pytest.raises(InputError, match=r"type9: no such file.*type1, type2, type3, type4"):
        load_specimen("type9")


def test_a_name_may_consist_of_one_character_but_may_not_be_empty() -> None:
    shortest = {}
    for document in (People, Protocol, Rig, SpecimenFile):
        schema = document.model_json_schema()
        for table, described in {**schema["$defs"], document.__name__: schema}.items():
            for name, field in described.get("properties", {}).items():
                for kind in [field, *field.get("anyOf", [])]:
                    if "minLength" in kind:
                        shortest[table, name] = kind["minLength"]
    assert set(shortest.values()) == {1}
    required = {("Protocol", "name"), ("Protocol", "material"), ("Beam", "name"), ("Beam", "material"), ("Rig", "name")}
    assert shortest.keys() >= required | {("Person", "given_name"), ("Person", "family_name"), ("Supply", "address")}


@given(text=st.text(max_size=200))
def test_any_text_is_read_or_refused_in_one_line(text: str) -> None:
    for model in (Protocol, SpecimenFile, Calibration):
        with pytest.raises(InputError) as caught:
            parse(model, text, "some.toml")
        assert "\n" not in str(caught.value)


def test_the_calibration_of_a_rig_needs_a_coil_constant(tmp_path: Path) -> None:
    for name in ("virtual.toml", "virtual_materials.toml", "virtual_calibration.toml"):
        text = (SHIPPED / "rigs" / name).read_text() if (SHIPPED / "rigs" / name).is_file() else ""
        (tmp_path / name).write_text(text.replace("coil_constant_mT_per_A = ", "# "))
    with pytest.raises(InputError, match="the calibration of a rig needs coil_constant_mT_per_A"):
        load_rig(tmp_path / "virtual.toml")
