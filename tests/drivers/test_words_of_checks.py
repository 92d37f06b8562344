"""If a driver breaks a requirement for all drivers, its check raises an error that names this requirement."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.emulators.serve import emulate
from eimi_drivers.interfaces import (
    Frame,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    Limits,
    Reading,
)
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.base import SupplyBase
from eimi_drivers.testing import CAMERA_CHECKS, check_camera, check_supply
from eimi_drivers.testing.claims import claim, must_raise, run_checks, within
from eimi_drivers.testing.supply_checks import SUPPLY_CHECKS
from tests.patience import PATIENCE_S

Scpi: Any = SUPPLIES["scpi"]
Kepco: Any = SUPPLIES["kepco-bop"]


def supply(base: Any = Scpi, **members: Any) -> type:
    # Return a driver class with methods or attributes replaced by `members`.
    return type("Replaced", (base,), members)


def identified(change: Callable[[Identity], Any]) -> type:
    return supply(identify=lambda self: change(Scpi.identify(self)))


def measuring(change: Callable[[Reading], Any]) -> type:
    return supply(measure=lambda self: change(Scpi.measure(self)))


def stays_on(self: Any, on: bool) -> None:
    if on:
        SupplyBase.set_output(self, on)


def lowers_the_limits(self: Any) -> Limits:
    return Limits(0.5, 12.0)


def changes_first(self: Any, *arguments: Any) -> None:
    self._send("CURR 0.123")
    SupplyBase._refuse_outside(self, *arguments)


def switches_off_and_closes(self: Any) -> None:
    self._send_output(False)
    SupplyBase.close(self)


def sets_a_voltage_when_opened(self: Any, link: Any, limits: Limits, clock: Any) -> None:
    Scpi.__init__(self, link, limits, clock)
    self._send_voltage("3.000")


SAYS_OFF = supply(output_on=lambda self: False, _verify_output=lambda self, on: None)


def sends_first(self: Any, current_A: float) -> None:
    self._send("*CLS")
    Scpi.set_current(self, current_A)


def sets_nothing_small(self: Any, current_A: float) -> None:
    if not math.isfinite(current_A) or current_A >= 0.5 or current_A <= 0:
        Scpi.set_current(self, current_A)


def accepts_negative(self: Any, current_A: float) -> None:
    if current_A >= 0 or not math.isfinite(current_A) or current_A < -0.1:
        Scpi.set_current(self, current_A)


def complains_while(on: bool) -> Callable[..., None]:
    # Return a faulty method `check`, which raises an error while the output is on (or off, if not `on`).
    def check(self: Any) -> None:
        Scpi.check(self)
        if self.output_on() is on:
            raise InstrumentError(f"a complaint while the output is {'on' if on else 'off'}")

    return check


def quietly(*errors: type[Exception]) -> Callable[[str], Callable[..., Any]]:
    # Return a function that makes a faulty copy of a method of `Scpi`; the copy ignores the given exceptions.
    def member(name: str) -> Callable[..., Any]:
        def act(self: Any, *arguments: Any) -> Any:
            try:
                return getattr(Scpi, name)(self, *arguments)
            except errors:
                return None

        return act

    return member


ignoring = quietly(InstrumentError)

SUPPLIES_IN_WORDS: list[tuple[str, type, str]] = [
    ("says_who_it_is", identified(lambda identity: identity.text), r"identify\(\) should return an Identity"),
    ("says_who_it_is", identified(lambda i: replace(i, text="")), r"identify\(\) should return a driver and a text"),
    ("says_who_it_is", identified(lambda i: replace(i, driver="")), r"identify\(\) should return a driver and a text"),
    (
        "says_who_it_is",
        identified(lambda i: replace(i, address="x")),
        r"should return the address 'in-process', not 'x'",
    ),
    (
        "drives_the_coil_and_switches_it_off",
        supply(output_on=lambda self: 1 if Scpi.output_on(self) else False),
        r"output_on\(\) should be True after set_output\(True\)",
    ),
    (
        "drives_the_coil_and_switches_it_off",
        supply(set_current=sets_nothing_small),
        r"the current in the coil should be 0\.2 A as set, but it is 0\.7 A",
    ),
    (
        "drives_the_coil_and_switches_it_off",
        supply(set_output=stays_on),
        r"the instrument's output should be off after set_output\(False\), but it is on",
    ),
    (
        "drives_the_coil_and_switches_it_off",
        supply(output_on=lambda self: Scpi.output_on(self) or 0, _verify_output=lambda self, on: None),
        r"output_on\(\) should be False after set_output\(False\)",
    ),
    (
        "drives_the_coil_and_switches_it_off",
        measuring(lambda reading: (reading.current_A, reading.voltage_V)),
        r"measure\(\) should return a Reading, not \(",
    ),
    (
        "drives_the_coil_and_switches_it_off",
        measuring(lambda reading: replace(reading, voltage_V=reading.voltage_V + 0.06)),
        r"measure\(\) should return 0\.7 A and 2\.8 V",
    ),
    (
        "drives_the_coil_and_switches_it_off",
        measuring(lambda reading: replace(reading, current_A=reading.current_A - 0.011)),
        r"measure\(\) should return 0\.7 A and 2\.8 V",
    ),
    (
        "drives_the_coil_and_switches_it_off",
        supply(check=complains_while(True)),
        r"InstrumentError: a complaint while the output is on",
    ),
    (
        "drives_the_coil_and_switches_it_off",
        supply(check=complains_while(False)),
        r"InstrumentError: a complaint while the output is off",
    ),
    (
        "refuses_set_points_outside_its_limits",
        supply(limits=property(lowers_the_limits, lambda self, limits: None)),
        "limits should be the value with which the supply was opened",
    ),
    (
        "refuses_set_points_outside_its_limits",
        supply(set_current=sends_first),
        r"a refused set-point was sent: \[b'\*CLS",
    ),
    (
        "refuses_set_points_outside_its_limits",
        supply(set_current=ignoring("set_current")),
        r"set_current\(.*should raise",
    ),
    (
        "refuses_set_points_outside_its_limits",
        supply(set_voltage=ignoring("set_voltage")),
        r"set_voltage\(.*should raise",
    ),
    (
        "reverses_its_current_only_if_it_is_bipolar",
        supply(set_current=accepts_negative),
        r"set_current\(-0\.001\) should raise SetPointRefused",
    ),
    ("reverses_its_current_only_if_it_is_bipolar", supply(set_current=sends_first), "a refused set-point was sent"),
    (
        "reverses_its_current_only_if_it_is_bipolar",
        supply(Kepco, set_current=lambda self, current_A: Kepco.set_current(self, abs(current_A))),
        r"the current in the coil should be -0\.7 A",
    ),
    ("reads_its_set_points_back", supply(set_current=ignoring("set_current")), r"set_current\(0\.7\) on an instrument"),
    ("reads_its_set_points_back", supply(set_voltage=ignoring("set_voltage")), r"set_voltage\(12\) on an instrument"),
    ("notices_a_locked_front_panel", supply(set_current=ignoring("set_current")), r"set_current\(0\.2\) of a locked"),
    ("notices_a_locked_front_panel", supply(safe_off=ignoring("safe_off")), r"safe_off\(\) of a locked supply"),
    (
        "notices_a_locked_front_panel",
        supply(set_output=ignoring("set_output")),
        r"set_output\(False\) of a locked supply",
    ),
    ("reports_a_protection_trip", supply(check=ignoring("check")), r"check\(\) after a trip should raise"),
    (
        "gives_up_on_a_silent_line",
        supply(output_on=lambda self: bool(ignoring("output_on")(self))),
        r"output_on\(\) on a silent line should raise InstrumentTimeout",
    ),
    ("gives_up_on_a_silent_line", supply(measure=ignoring("measure")), r"measure\(\) on a silent line should raise"),
    (
        "gives_up_on_a_silent_line",
        supply(measure=lambda self: (self._clock.sleep(5.0), Scpi.measure(self))[1]),
        r"measure\(\) should end within 5 s, but took",
    ),
    (
        "understands_no_garbage",
        supply(identify=ignoring("identify")),
        r"identify\(\) with an unreadable answer should raise",
    ),
    (
        "understands_no_half_answers",
        supply(measure=ignoring("measure")),
        r"measure\(\) with an incomplete answer should raise",
    ),
    ("reports_a_cut_line", supply(measure=ignoring("measure")), r"measure\(\) on a line that was cut should raise"),
    ("reports_a_cut_line", supply(safe_off=ignoring("safe_off")), r"safe_off\(\) on a line that was cut should raise"),
    (
        "is_off_after_safe_off_from_every_state",
        supply(safe_off=lambda self: Scpi.set_current(self, 0.0)),
        r"the output should be off after safe_off\(\)|output_on\(\) should be False after safe_off",
    ),
    (
        "is_off_after_safe_off_from_every_state",
        supply(safe_off=lambda self: Scpi.set_output(self, False)),
        r"the current set-point should be 0 A after safe_off\(\) of a supply that was off with .* it is 0\.7 A",
    ),
    (
        "refuses_set_points_outside_its_limits",
        supply(_refuse_outside=changes_first),
        "a refused set-point changed the instrument",
    ),
    (
        "reverses_its_current_only_if_it_is_bipolar",
        supply(Kepco, output_on=lambda self: False, _verify_output=lambda self, on: None),
        r"output_on\(\) should be True at -0\.7 A",
    ),
    ("tries_every_stage_of_switching_off", supply(safe_off=lambda self: None), "although the message .* was lost"),
    (
        "gives_up_on_a_silent_line",
        supply(output_on=lambda self: Scpi.output_on(self) or True),
        r"output_on\(\) should be False after the instrument answers again",
    ),
    (
        "understands_no_garbage",
        supply(output_on=lambda self: Scpi.output_on(self) or True),
        r"output_on\(\) should be False after an unreadable answer to identify\(\)",
    ),
    (
        "is_off_after_safe_off_from_every_state",
        supply(safe_off=lambda self: None if Scpi.output_on(self) else Scpi.safe_off(self)),
        r"the output should be off after safe_off\(\) of a supply that was on at 0\.7 A, but it is on",
    ),
    (
        "takes_no_late_answer_for_the_next",
        SAYS_OFF,
        r"output_on\(\) should be True after measure\(\) was answered late",
    ),
    (
        "leaves_the_output_alone_when_it_is_opened_or_closed",
        supply(close=switches_off_and_closes),
        r"close\(\) should not change the instrument; only safe_off\(\) switches off",
    ),
    (
        "leaves_the_output_alone_when_it_is_opened_or_closed",
        supply(__init__=sets_a_voltage_when_opened),
        "opening should not change the instrument; an output that is on stays on",
    ),
    (
        "leaves_the_output_alone_when_it_is_opened_or_closed",
        SAYS_OFF,
        r"output_on\(\) should be True for a supply that was on when it was opened",
    ),
]


def test_every_check_of_a_supply_has_a_broken_requirement() -> None:
    named = {name for name, *_ in SUPPLIES_IN_WORDS}
    assert {check.__name__ for check in SUPPLY_CHECKS} - named == {
        "waits_for_a_slow_answer"  # see `test_bad_supply_drivers`
    }


@pytest.mark.parametrize(
    ("name", "driver", "words"),
    SUPPLIES_IN_WORDS,
    ids=[f"{name}-{k}" for k, (name, *_) in enumerate(SUPPLIES_IN_WORDS)],
)
def test_the_broken_requirement_of_a_supply_is_named(name: str, driver: Any, words: str) -> None:
    checks = [check for check in SUPPLY_CHECKS if check.__name__ == name]
    family = driver.profile.driver
    check_supply(SUPPLIES[family], lambda coil: emulate(family, coil), checks=checks)
    with pytest.raises(AssertionError, match=f"the supply driver Replaced: {name}: .*{words}"):
        check_supply(driver, lambda coil: emulate(family, coil), checks=checks)


class Good:
    # A camera that fulfils every requirement.

    def __init__(self, source: str | int, settings: CameraSettings) -> None:
        if source == "absent":
            raise InstrumentDisconnected("nobody is there")
        if settings.region is not None and 0 in settings.region[2:]:
            raise InstrumentError("empty")
        self.settings, self.number, self.closed = settings, 0, False

    def identify(self) -> Identity:
        return Identity("good", "a camera", "here")

    def flush(self) -> None:
        pass

    def grab(self, timeout_s: float) -> Frame:
        if self.closed:
            raise InstrumentDisconnected("here: closed")
        self.number += 1
        width, height = self.settings.region[2:] if self.settings.region else (5, 4)
        return Frame(np.full((height, width), self.number, np.uint8), self.number, float(self.number))

    def close(self) -> None:
        self.closed = True


def grabbing(change: Callable[[Frame], Any]) -> type:
    return type("Changed", (Good,), {"grab": lambda self, timeout_s: change(Good.grab(self, timeout_s))})


def only_in_the_main_thread(frame: Frame) -> Frame:
    if threading.current_thread() is not threading.main_thread():
        raise InstrumentError("not in the main thread")
    return frame


def camera_identified(identity: Any) -> type:
    return type("Changed", (Good,), {"identify": lambda self: identity})


def opens_once(self: Any, source: str | int, settings: CameraSettings) -> None:
    if type(self).opened:
        raise InstrumentError("in use")
    type(self).opened = True
    Good.__init__(self, source, settings)


CAMERAS_IN_WORDS: list[tuple[str, type, str]] = [
    ("says_who_it_is", camera_identified("me"), r"identify\(\) should return an Identity, not 'me'"),
    ("says_who_it_is", camera_identified(Identity("", "text", "here")), "should return a driver and a text"),
    ("says_who_it_is", camera_identified(Identity("good", "", "here")), "should return a driver and a text"),
    (
        "gives_frames_in_order",
        grabbing(lambda frame: replace(frame, image=frame.image[: 1 + frame.number % 2])),
        "all frames should have the same shape, but their shapes differ",
    ),
    (
        "gives_frames_in_order",
        grabbing(lambda f: replace(f, number=1)),
        r"numbers should increase, but are \[1, 1, 1\]",
    ),
    (
        "gives_frames_in_order",
        grabbing(lambda frame: replace(frame, timestamp_s=-frame.timestamp_s)),
        r"time stamps should not decrease, but are \[-1\.0, -2\.0, -3\.0\] s",
    ),
    (
        "gives_frames_in_order",
        grabbing(lambda frame: replace(frame, image=frame.image.tolist())),
        "the image of a frame should be an array, not list",
    ),
    (
        "refuses_a_setting_that_cannot_be",
        type("Changed", (Good,), {"__init__": lambda self, source, settings: self.__dict__.update(settings=settings)}),
        r"opening with CameraSettings\(.*\) should raise InstrumentError",
    ),
    ("gives_frames_in_order", grabbing(lambda frame: frame.image), "should return a Frame|Frame"),
    ("gives_frames_in_order", grabbing(lambda frame: replace(frame, timestamp_s=math.nan)), "time"),
    (
        "gives_frames_in_order",
        grabbing(lambda frame: replace(frame, image=frame.image.astype(np.int16))),
        "uint8 or uint16",
    ),
    ("gives_frames_in_order", grabbing(lambda frame: replace(frame, image=frame.image[0])), "uint8 or uint16|shape"),
    (
        "reads_its_settings_back",
        grabbing(lambda frame: replace(frame, image=frame.image.T)),
        r"a region of 3 x 2 pixels should give images of this size, not \(3, 2\)",
    ),
    (
        "refuses_a_setting_that_cannot_be",
        type(
            "Changed",
            (Good,),
            {"__init__": lambda self, source, settings: Good.__init__(self, source, CameraSettings())},
        ),
        "should raise InstrumentError|was set to",
    ),
    (
        "is_closed_when_it_is_closed",
        type("Changed", (Good,), {"close": lambda self: None}),
        r"grab\(\) of a closed camera should raise InstrumentError, but returned Frame",
    ),
    ("is_closed_when_it_is_closed", type("Changed", (Good,), {"__init__": opens_once, "opened": False}), "in use"),
    ("works_in_a_thread_of_its_own", grabbing(only_in_the_main_thread), "not in the main thread"),
    ("refuses_a_setting_that_cannot_be", type("Changed", (Good,), {"__init__": opens_once, "opened": False}), "in use"),
]


@pytest.mark.parametrize(
    ("name", "driver", "words"), CAMERAS_IN_WORDS, ids=[f"{name}-{k}" for k, (name, *_) in enumerate(CAMERAS_IN_WORDS)]
)
def test_the_broken_requirement_of_a_camera_is_named(name: str, driver: Any, words: str) -> None:
    checks = [check for check in CAMERA_CHECKS if check.__name__ == name]
    settings = CameraSettings(region=(0, 0, 3, 2))
    check_camera(Good, 0, settings=settings, absent="absent", checks=checks)
    with pytest.raises(AssertionError, match=f"the camera driver Changed: {name}: .*({words})"):
        check_camera(driver, 0, settings=settings, checks=checks)


@pytest.mark.parametrize("stored", [0, 8])
def test_a_disturbed_camera_may_return_the_frames_that_it_has_stored(stored: int) -> None:
    last: list[Any] = []

    class Stored(Good):
        error: type[InstrumentError] | None = None
        left = stored

        def grab(self, timeout_s: float) -> Frame:
            last.append(self)
            if self.error is not None and self.left == 0:
                raise self.error("no more")
            if self.error is not None:
                self.left -= 1
            return super().grab(timeout_s)

        def disturb(self, error: type[InstrumentError]) -> None:
            self.error = error

    opened: list[Stored] = []

    def open_it(source: str | int, settings: CameraSettings) -> Stored:
        opened.append(Stored(source, settings))
        return opened[-1]

    names = ("gives_up_on_a_camera_that_hangs", "says_that_it_was_unplugged")
    checks = [check for check in CAMERA_CHECKS if check.__name__ in names]
    check_camera(
        open_it,
        0,
        freeze=lambda: opened[-1].disturb(InstrumentTimeout),
        unplug=lambda: opened[-1].disturb(InstrumentDisconnected),
        checks=checks,
    )
    assert len(last) == 2 * (stored + 1)


def test_a_requirement_that_is_met_gives_no_message() -> None:
    claim(True, "words")
    with pytest.raises(AssertionError, match=r"^words$"):
        claim(False, "words")


def test_the_error_of_an_act_is_returned_or_named() -> None:
    def fail(error: BaseException) -> Callable[[], object]:
        def act() -> object:
            raise error

        return act

    error = KeyError("x")
    assert must_raise((KeyError, ValueError), "it", fail(error)) is error
    with pytest.raises(AssertionError, match=r"^it should raise KeyError or ValueError, but raised OSError: y$"):
        must_raise((KeyError, ValueError), "it", fail(OSError("y")))
    with pytest.raises(AssertionError, match=r"^late$"):
        must_raise((KeyError,), "it", fail(AssertionError("late")))
    with pytest.raises(AssertionError, match=r"^it should raise KeyError, but returned 'a{58}'$"):
        must_raise((KeyError,), "it", lambda: 58 * "a")
    with pytest.raises(AssertionError, match=r"but returned 'a{59}\.\.\.$"):
        must_raise((KeyError,), "it", lambda: 99 * "a")


def test_an_act_returns_its_value_its_error_or_is_too_late() -> None:
    import threading

    assert within(PATIENCE_S, "it", lambda: 5) == 5
    error = OSError("x")

    def fail() -> object:
        raise error

    with pytest.raises(OSError) as caught:  # noqa: PT011
        within(PATIENCE_S, "it", fail)
    assert caught.value is error
    with pytest.raises(AssertionError, match=r"^it should end within 0\.01 s, but did not$"):
        within(0.01, "it", threading.Event().wait)


def test_all_failed_checks_are_listed_with_a_new_bench_each() -> None:
    from contextlib import nullcontext

    benches = iter("abc")

    def first(bench: str) -> None:
        raise AssertionError(f"words\n  of {bench}")

    def second(bench: str) -> None:
        assert bench == "b"

    def third(bench: str) -> None:
        raise OSError(bench)

    with pytest.raises(AssertionError) as caught:
        run_checks("the driver", [first, second, third], lambda: nullcontext(next(benches)))
    assert str(caught.value) == "the driver: first: words of a; third: OSError: c"
    assert str(caught.value.__cause__) == "words\n  of a"
    run_checks("the driver", [], lambda: nullcontext("x"))
