"""This file lists every named number of the drivers, of acquisition and of the intervals, and every numerical default.

A change of one of these numbers changes what a user sees, or how long a user waits. Whoever changes a number or adds
one states it here, with its reason or its source. `tests/lab/test_stated_times.py` compares the numbers of a run with
the documentation.
"""

from __future__ import annotations

import ast
import importlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

PROJECT = Path(__file__).parents[1]

DRIVERS: dict[str, dict[str, float]] = {
    "eimi_drivers.cameras.aravis": {
        "BUFFERS": 32,
        "ANSWER_WITHIN_S": 0.4,
        "CLOSE_WITHIN_S": 2.0,
        "CONTROL_FREE_WITHIN_S": 4.0,  # longer than the 3 s of the heartbeat
        "LOOK_EVERY_S": 0.05,
        "LARGEST_ID": 2**16 - 1,  # GigE Vision 1 counts in 16 bits
    },
    "eimi_drivers.cameras.aravis_library": {"SUCCESS": 0},  # ARV_BUFFER_STATUS_SUCCESS
    "eimi_drivers.cameras.aravis_settings": {
        "_CONTINUOUS": 0,  # ARV_ACQUISITION_MODE_CONTINUOUS
        "_AUTO_OFF": 0,  # ARV_AUTO_OFF
        "_CHECK_RANGES": 1,  # ARV_RANGE_CHECK_POLICY_ENABLE
    },
    "eimi_drivers.cameras.basler": {"USB_TICKS_PER_S": 1e9, "BUFFERS": 32},
    "eimi_drivers.cameras.gentl": {"BUFFERS": 32, "SHORTEST_S": 0.001, "_IMAGE": 1},  # PAYLOAD_TYPE_IMAGE
    "eimi_drivers.cameras.opencv": {
        "CLOSE_WITHIN_S": 2.0,
        "BUFFERS": 32,
        "V4L2_EXPOSURES_PER_S": 1e4,  # units of 100 us
        "V4L2_MANUAL_EXPOSURE": 1,  # V4L2_EXPOSURE_MANUAL
        "WINDOWS_MANUAL_EXPOSURE": 0.25,
        "GREY_16": int.from_bytes(b"Y16 ", "little"),
    },
    "eimi_drivers.cameras.settings": {"WITHIN": 0.02, "FRAMES_ON_THE_WAY": 2},
    "eimi_drivers.cameras.timed": {"OPEN_WITHIN_S": 60.0, "ANSWER_WITHIN_S": 5.0, "GRACE_S": 0.5, "LOOK_EVERY_S": 0.1},
    "eimi_drivers.emulators.aim_tti": {
        "COMMAND_ERROR": 32,  # bits of the event status register (IEEE 488.2)
        "NUMBERED_ERROR": 16,
        "POWER_ON": 128,
        "CONSTANT_VOLTAGE": 1,
        "CONSTANT_CURRENT": 2,
        "LOCKED_OUT": 200,
    },
    "eimi_drivers.emulators.coil_line": {"ANSWER_WITHIN_S": 30.0},
    "eimi_drivers.emulators.faults": {
        "SLEEPS_FOR_S": 12.0,  # longer than a run and its guardian may stand still together
        "RESTARTS_WITHIN_S": 1.0,
        "SHORTED_A": 0.8,
        "DRIFTS_TO_A": 2.4,
        "OFFSET_A": 0.015,  # below the current that counts as off
        "HUNTING_A": 0.2,
    },
    "eimi_drivers.emulators.gige_camera": {"CONTROL_PORT": 3956},  # of GVCP
    "eimi_drivers.emulators.gige_features": {  # registers (arvfakecamera.h and arvgvcpprivate.h of Aravis)
        "SENSOR_HEIGHT": 0x118,
        "SENSOR_WIDTH": 0x11C,
        "WIDTH": 0x100,
        "HEIGHT": 0x104,
        "OFFSET_X": 0x130,
        "OFFSET_Y": 0x134,
        "PIXEL_FORMAT": 0x128,
        "ACQUISITION": 0x124,
        "ACQUISITION_MODE": 0x12C,
        "FRAME_PERIOD_US": 0x138,
        "EXPOSURE_US": 0x120,
        "TRIGGER_MODE": 0x300,
        "TRIGGER_SOURCE": 0x304,
        "TRIGGER_ACTIVATION": 0x308,
        "TRIGGER_SOFTWARE": 0x30C,
        "GAIN": 0x110,
        "GAIN_AUTO": 0x114,
        "ROW_READOUT_US": 10,
    },
    "eimi_drivers.emulators.gige_process": {"START_WITHIN_S": 120.0, "END_WITHIN_S": 5.0, "LOOK_EVERY_S": 0.1},
    "eimi_drivers.emulators.hislip": {  # types of messages (IVI-6.1, table 4)
        "INITIALIZE": 0,
        "DATA": 6,
        "DATA_END": 7,
        "ASYNC_MESSAGE_SIZE": 15,
        "ASYNC_INITIALIZE": 17,
        "VERSION_1_0": 0x0100,
        "LARGEST_MESSAGE": 2**20,
    },
    "eimi_drivers.emulators.keithley": {"OVER_VOLTAGE": 1, "SHUT_DOWN": 2048},
    "eimi_drivers.emulators.keysight_systems": {"PROTECTED": 2048},
    "eimi_drivers.emulators.owon": {"STANDBY": 0, "CONSTANT_VOLTAGE": 1, "CONSTANT_CURRENT": 2, "FAILURE": 3},
    "eimi_drivers.emulators.sensor_session": {"LOOK_EVERY_S": 0.05, "NOISE_MT": 0.005},
    "eimi_drivers.emulators.serial_port": {"PLUGGED_IN_AFTER_S": 0.3},
    "eimi_drivers.emulators.session": {
        "LOOK_EVERY_S": 0.05,
        "LEAST_CHANGE_A": 0.02,
        "OPEN_OHM": 1e9,
        "AWAY_FOR_S": 1.0,
    },
    "eimi_drivers.emulators.supply": {"COPPER_PER_K": 0.00393, "HUNTING_HZ": 0.7, "LEAST_A": 1e-12},  # IEC 60028
    "eimi_drivers.lan_instruments": {"SEARCH_S": 2.5},
    "eimi_drivers.sensors.base": {"LATE_ANSWER_S": 0.5, "LONGEST_LINE": 256},
    "eimi_drivers.sensors.coil_thermometer": {
        "COPPER_PER_K": 0.00393,  # at 20 degC (IEC 60028)
        "COEFFICIENT_AT_DEGC": 20.0,
        "STEP_V": 0.01,
        "STEP_A": 0.001,
        "READINGS_AT_REST": 10,
        "BETWEEN_READINGS_S": 0.2,
        "LEAST_SHARE": 0.2,
    },
    "eimi_drivers.sensors.text_line": {"STARTS_WITHIN_S": 3},
    "eimi_drivers.supplies.aim_tti": {"LONGEST_LINE": 256, "LAST_HARDWARE_ERROR": 99, "NUMBERED_ERROR": 16},
    "eimi_drivers.supplies.base": {"READ_BACK_WITHIN_S": 0.6},
    "eimi_drivers.supplies.conversation": {"REPLY_TIMEOUT_S": 1.0, "LATE_ANSWER_S": 1.0},
    "eimi_drivers.supplies.genesys": {"LONGEST_LINE": 128, "BLIND_GAP_S": 0.05, "READ_BACK_OF_RATING": 0.003},
    "eimi_drivers.supplies.kepco": {"READS_ZERO_WITHIN_A": 0.05},
    "eimi_drivers.supplies.korad": {
        "MESSAGE_GAP_S": 0.08,
        "OUTPUT_BIT": 0x40,
        "PROTECTION_BITS": 0xA0,
        "_VALUE_BYTES": 5,
    },
    "eimi_drivers.supplies.off": {
        "LEAST_OFF_A": 0.02,  # the zero of the meter of a healthy supply
        "DECAYS_WITHIN_S": 2.0,
        "MEASURE_EVERY_S": 0.05,
        "MEASURING_ATTEMPTS": 2,
    },
    "eimi_drivers.supplies.owon": {"FIELDS": 7, "MOST_REFUSALS": 3},
    "eimi_drivers.supplies.protections": {"PROTECTION_MARGIN": 1.1},
    "eimi_drivers.supplies.scpi": {"LONGEST_LINE": 4096, "LONGEST_ERROR_QUEUE": 50},
    "eimi_drivers.supplies.transport": {"WRITE_TIMEOUT_S": 2.0, "POLL_EVERY_S": 0.002},
    "eimi_drivers.supplies.values": {
        "_NOT_A_MEASUREMENT": 1e30
    },  # 9.9E37 is infinity, 9.91E37 not a number (SCPI-99, 7.2.1)
    "eimi_drivers.supplies.visa": {"OPEN_TIMEOUT_S": 3.0},
    "eimi_drivers.supplies.xln": {"OUTPUT_BIT": 0x04, "ARMED_BITS": 0xC0, "STATUS_DIGITS": 6},
    "eimi_drivers.testing.camera_checks": {
        "FRAME_WITHIN_S": 10.0,
        "SHORT_S": 0.2,
        "ENDS_WITHIN_S": 30.0,
        "FRAMES": 3,
        "STORED": 8,
    },
    "eimi_drivers.testing.claims": {"LONGEST": 60},
    "eimi_drivers.testing.sensor_checks": {"PATIENCE_S": 60.0, "CALL_WITHIN_S": 2.0},
    "eimi_drivers.testing.supply_bench": {
        "RESISTANCE_OHM": 4.0,
        "TIME_CONSTANT_S": 0.01,
        "SETTLED_AFTER_S": 0.2,  # 20 time constants
        "PATIENCE_S": 60.0,
    },
    "eimi_drivers.testing.supply_checks": {
        "CURRENT_WITHIN_A": 0.01,
        "VOLTAGE_WITHIN_V": 0.05,
        "LATE_S": 1.3,  # later than a driver waits for an answer
    },
}

ACQUISITION: dict[str, dict[str, float]] = {
    "eimi_lab.acquisition.coil": {
        "REACHED_WITHIN_S": 3.0,
        "POLL_S": 0.1,
        "SIMULATED_CHECK_EVERY_S": 2.0,
        "SIMULATED_CHECK_AT_ZERO_EVERY_S": 8.0,
        "WATCH_EVERY_S": 1.5,
        "FOLLOWS_WITHIN_S": 1.5,
        "EXCHANGES_REMEMBERED": 3,
        "MEASURED_AGAIN_AFTER_S": 0.2,
    },
    "eimi_lab.acquisition.coil_calibration": {"SETTLED_AFTER_S": 0.5, "BETWEEN_READINGS_S": 0.1, "READINGS": 5},
    "eimi_lab.acquisition.dry_run": {
        "FIRST_STATES": 6,
        "LAST_STATES": 2,
        "FRAME_S": 1 / 30,
        "ABOVE_LIMITS": 1.2,
        "GENESYS_V": 30.0,
        "RESISTANCE_OHM": 0.01,
    },
    "eimi_lab.acquisition.event_lines": {"LAST_LINES_S": 1.0},
    "eimi_lab.acquisition.event_words": {"VISIBLE_MOTION_PX": 0.2},
    "eimi_lab.acquisition.guardian": {
        "READY_WITHIN_S": 120.0,
        "STILL_FOR_S": 5.0,
        "SILENT_FOR_S": 1.5,
        "BEAT_EVERY_S": 0.1,
        "LONGEST_GAP_S": 10.0,
        "TAKING_OVER_WITHIN_S": 10.0,
    },
    "eimi_lab.acquisition.guardian_process": {
        "TRY_FOR_S": 3600.0,
        "TRY_AGAIN_AFTER_S": 0.1,
        "TRY_AGAIN_LATER_S": 1.0,
        "REPORT_EVERY_S": 60.0,
        "DOUBTED_AFTER_S": 2.0,
        "FROM_RUN": 0,  # standard input and standard output
        "TO_RUN": 1,
    },
    "eimi_lab.acquisition.heating": {"FRAME_WITHIN_S": 0.5, "STORED_WITHIN_S": 0.1},
    "eimi_lab.acquisition.pausing": {"LOOK_EVERY_S": 0.1},
    "eimi_lab.acquisition.playback": {"HELD_FRAME_S": 1 / 30, "NOISE_FRAMES": 8},
    "eimi_lab.acquisition.ring_downs": {"_LOOK_EVERY_S": 0.1, "_EARLY_S": 0.5, "_SAME_PACE": 0.02, "_WAITED_S": 1.0},
    "eimi_lab.acquisition.sensing": {"TRIED_AGAIN_AFTER_S": 2.0},
    "eimi_lab.acquisition.settling": {"GRAB_TIMEOUT_S": 5.0},
    "eimi_lab.acquisition.supply_trial": {
        "VOLTAGE_V": 1.0,
        "CURRENT_A": 0.1,
        "ON_FOR_S": 4.0,
        "VOLTAGE_WITHIN_V": 0.1,
        "READINGS": 10,
    },
    "eimi_lab.acquisition.switching_off": {"OFF_WITHIN_S": 30.0, "DOUBTED_AFTER_S": 0.5},
    "eimi_lab.acquisition.transients": {"SHORTEST_S": 0.001},
}

INTERVAL: dict[str, dict[str, float]] = {
    "eimi_fitting.inference.interval.considered": {"_TOLERANCE_MM": 0.001, "_FARTHEST": 2.0},
    "eimi_fitting.inference.interval.draws": {"_DRAWN": 4000, "_KEPT": 400, "_DIGITS": 7},
    "eimi_fitting.inference.interval.estimate": {
        "_APPARENT_COMPRESSIBILITY": 10.0,
        "_AT_BOUND": 0.001,
        "_SLOPE_STEP": 0.0001,
    },
    "eimi_fitting.inference.interval.identifiability": {
        "NOT_FIXED": 0.5,
        "_ROUGH": 0.25,
        "_OF_RANGE": 2 * 1.96 / math.sqrt(12.0),  # 95 % interval of a uniform distribution, over its range
        "_OPEN_FACTOR": 4.0,
        "_NAMED": 0.1,
        "_CORRELATED": 0.9,
    },
    "eimi_fitting.inference.interval.noise": {"_ROUNDS": 12, "_SAME": 0.01, "_PASSES": 3},
    "eimi_fitting.inference.interval.profile_likelihood": {
        "_AGREES": 0.2,
        "_CONVERGED": 0.03,
        "_NEAR": 0.1,
        "_MOST_ROUNDS": 8,
        "_SHORTEST": 0.4,
        "_LONGEST": 2.0,
    },
}

PACKAGES = {
    "eimi_drivers": ("drivers/eimi_drivers", DRIVERS),
    "eimi_lab.acquisition": ("eimi_lab/acquisition", ACQUISITION),
    "eimi_fitting.inference.interval": ("fitting/eimi_fitting/inference/interval", INTERVAL),
}

DEFAULTS = """
eimi_drivers.clock __init__ start_s 0.0
eimi_drivers.emulators.aim_tti Model out_of_range 100
eimi_drivers.emulators.aim_tti Model over_current 8
eimi_drivers.emulators.aim_tti Model over_voltage 4
eimi_drivers.emulators.aim_tti Model range_refused 104
eimi_drivers.emulators.aim_tti __init__ channel 1
eimi_drivers.emulators.channel_selected __init__ channel 1
eimi_drivers.emulators.coil_line serve_coil port 0
eimi_drivers.emulators.delta __init__ channel 1
eimi_drivers.emulators.faults __init__ late_s 0.3
eimi_drivers.emulators.genesys __init__ unit 6
eimi_drivers.emulators.gige_camera serve_gige rows_step 1
eimi_drivers.emulators.gige_camera serve_gige triggers_per_s 100.0
eimi_drivers.emulators.gige_features describe rows_step 1
eimi_drivers.emulators.keysight_systems __init__ channel 1
eimi_drivers.emulators.korad __init__ fuse_within_s 0.0
eimi_drivers.emulators.korad __init__ protection_bit 32
eimi_drivers.emulators.scpi ScpiDialect serial_line_begins_local False
eimi_drivers.emulators.scpi __init__ channel 1
eimi_drivers.emulators.scpi_families __init__ channel 1
eimi_drivers.emulators.sensors __init__ noise 0.0
eimi_drivers.emulators.sensors __init__ seed 0
eimi_drivers.emulators.serve serve_tcp port 0
eimi_drivers.emulators.supply SupplyState armed False
eimi_drivers.emulators.supply SupplyState at_s 0.0
eimi_drivers.emulators.supply SupplyState coil_current_A 0.0
eimi_drivers.emulators.supply SupplyState heating_K 0.0
eimi_drivers.emulators.supply SupplyState output False
eimi_drivers.emulators.supply SupplyState set_current_A 0.0
eimi_drivers.emulators.supply SupplyState set_voltage_V 0.0
eimi_drivers.emulators.supply SupplyState tripped False
eimi_drivers.emulators.supply __init__ current_noise_A 0.0
eimi_drivers.emulators.supply __init__ max_current_A 5.0
eimi_drivers.emulators.supply __init__ max_voltage_V 30.0
eimi_drivers.emulators.supply __init__ resistance_ohm 4.0
eimi_drivers.emulators.supply __init__ seed 0
eimi_drivers.emulators.supply __init__ thermal_resistance_K_per_W 0.0
eimi_drivers.emulators.supply __init__ thermal_time_constant_s 600.0
eimi_drivers.emulators.supply __init__ time_constant_s 0.05
eimi_drivers.emulators.supply __init__ voltage_noise_V 0.0
eimi_drivers.emulators.supply drift rate_A_per_s 1.0
eimi_drivers.emulators.supply reset current_A 0.0
eimi_drivers.emulators.trip_level __init__ on True
eimi_drivers.interfaces Off found_off False
eimi_drivers.sensors.base SensorBase baud_rate 9600
eimi_drivers.sensors.base SensorBase data_bits 8
eimi_drivers.sensors.base SensorBase timeout_s 1.0
eimi_drivers.sensors.coil_thermometer CoilThermometer timeout_s 2.0
eimi_drivers.sensors.fw_bell FWBell5080 baud_rate 2400
eimi_drivers.sensors.lake_shore LakeShore425 baud_rate 57600
eimi_drivers.sensors.lake_shore LakeShore425 data_bits 7
eimi_drivers.sensors.lake_shore LakeShore475 baud_rate 9600
eimi_drivers.sensors.text_line TextLine baud_rate 115200
eimi_drivers.supplies.aim_tti Series switches_protections False
eimi_drivers.supplies.base SupplyBase bipolar False
eimi_drivers.supplies.base SupplyBase default_channel 1
eimi_drivers.supplies.base SupplyBase read_backs 1
eimi_drivers.supplies.conversation _question pause_s 0.0
eimi_drivers.supplies.profile Profile baud_rate 9600
eimi_drivers.supplies.profile Profile output_bit 0
eimi_drivers.supplies.profile Profile query_delay_s 0.0
eimi_drivers.supplies.profile Profile reads_zero_within_A 0.0
eimi_drivers.supplies.profile Profile stop_bits 1
eimi_drivers.supplies.profile Watchdog seconds 10
eimi_drivers.supplies.recognised Recognised port 0
eimi_drivers.supplies.transport __init__ baud_rate 9600
eimi_drivers.supplies.transport __init__ data_bits 8
eimi_drivers.supplies.transport __init__ stop_bits 1
eimi_drivers.supplies.visa open_visa baud_rate 9600
eimi_drivers.supplies.visa open_visa stop_bits 1
eimi_drivers.testing.supply_bench energise current_A 0.7
eimi_drivers.testing.supply_bench supply_bench answer_within_s 5.0
eimi_drivers.testing.supply_checks check_supply answer_within_s 5.0
eimi_fitting.inference.interval.budget Moves further 0.0
eimi_fitting.inference.interval.budget units of_noise 1.0
eimi_fitting.inference.interval.budget units of_sources 1.0
eimi_fitting.inference.interval.covariance covariance widened 1.0
eimi_fitting.inference.interval.cross_validation held_out_error_mm folds 5
eimi_fitting.inference.interval.draws draw_parameters seed 1
eimi_fitting.inference.interval.estimate estimate shift_percent 0.0
eimi_fitting.inference.interval.identifiability Identifiability model_mm 0.0
eimi_fitting.inference.interval.identifiability Identifiability stated_squares 0.0
eimi_fitting.inference.interval.identifiability statement priors False
eimi_fitting.inference.interval.noise Effect least_percent 0.0
eimi_fitting.inference.interval.noise Noise mean_model_mm 0.0
eimi_fitting.inference.interval.profile_likelihood _End inside 0.0
eimi_lab.acquisition.coil __init__ asked_A 0.0
eimi_lab.acquisition.coil __init__ simulated False
eimi_lab.acquisition.coil count_the_end ago_s 0.0
eimi_lab.acquisition.coil watch early_s 0.0
eimi_lab.acquisition.event_words _why run_killed False
eimi_lab.acquisition.events OffConfirmed run_killed False
eimi_lab.acquisition.events OffNotConfirmed run_killed False
eimi_lab.acquisition.events Paused swap_leads False
eimi_lab.acquisition.events off_confirmed run_killed False
eimi_lab.acquisition.guardian Ward recognised False
eimi_lab.acquisition.pausing wait swap_leads False
eimi_lab.acquisition.playback Cue state 0
eimi_lab.acquisition.run acquire force False
eimi_lab.acquisition.run acquire resume False
eimi_lab.acquisition.run acquire take_over False
eimi_lab.acquisition.settling wait_until_settled not_before_s 0.0
""".strip().splitlines()
"""Module, function or class, parameter or field, and default."""


def modules(package: str) -> Iterator[tuple[str, ast.Module]]:
    """Yield the full name of each module of a package, and its syntax tree."""
    folder = PROJECT / PACKAGES[package][0]
    for path in sorted(folder.rglob("*.py")):
        if path.stem not in ("__init__", "__main__"):
            name = ".".join((package, *path.relative_to(folder).with_suffix("").parts))
            yield name, ast.parse(path.read_text(encoding="utf-8"))


def is_number(value: Any) -> bool:
    """Return whether a value is an integer or a floating-point number, but neither a bool nor a member of an enum."""
    return type(value) in (int, float)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_number_with_a_name_is_the_stated_one(package: str) -> None:
    found: dict[str, dict[str, float]] = {}
    for name, tree in modules(package):
        assigned = [node for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign)]
        targets = [t for node in assigned for t in (node.targets if isinstance(node, ast.Assign) else [node.target])]
        names = [part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
        module = importlib.import_module(name) if names else None
        numbers = {each: vars(module)[each] for each in names if is_number(vars(module).get(each))}
        if numbers:
            found[name] = numbers
    stated = PACKAGES[package][1]
    assert {name: sorted(numbers) for name, numbers in found.items()} == {
        name: sorted(numbers) for name, numbers in stated.items()
    }
    for name, numbers in stated.items():
        assert found[name] == pytest.approx(numbers, rel=1e-12), name


def defaults() -> Iterator[str]:
    """Yield a line for each parameter and each field whose default is a number or a bool."""
    for package in PACKAGES:
        for name, tree in modules(package):
            for node in ast.walk(tree):
                pairs: list[tuple[str, ast.expr | None]] = []
                if isinstance(node, ast.FunctionDef):
                    given = [*node.args.posonlyargs, *node.args.args]
                    pairs = [
                        *zip(
                            (a.arg for a in given[len(given) - len(node.args.defaults) :]),
                            node.args.defaults,
                            strict=True,
                        ),
                        *zip((a.arg for a in node.args.kwonlyargs), node.args.kw_defaults, strict=True),
                    ]
                elif isinstance(node, ast.ClassDef):
                    pairs = [(ast.unparse(n.target), n.value) for n in node.body if isinstance(n, ast.AnnAssign)]
                for parameter, default in pairs:
                    if isinstance(default, ast.Constant) and (is_number(default.value) or type(default.value) is bool):
                        yield f"{name} {node.name} {parameter} {default.value}"  # type: ignore[attr-defined]


def test_every_default_number_is_the_stated_one() -> None:
    assert sorted(set(defaults())) == sorted(DEFAULTS)
