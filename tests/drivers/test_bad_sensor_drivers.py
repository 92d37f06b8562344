"""Every check of sensor drivers fails for a faulty driver, and its message names the check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from eimi_drivers.emulators.sensors import TextLineDialect
from eimi_drivers.interfaces import Identity, InstrumentDisconnected, InstrumentTimeout, SensorReading
from eimi_drivers.sensors import SENSORS
from eimi_drivers.testing import check_sensor
from eimi_drivers.testing.sensor_checks import SENSOR_CHECKS

TextLine: Any = SENSORS["text-line"]


def reading_differently(change: Callable[[SensorReading], Any]) -> type:
    class Driver(TextLine):
        def read(self) -> Any:
            return change(super().read())

    return Driver


def identified_as(change: Callable[[Identity], Any]) -> type:
    class Driver(TextLine):
        def identify(self) -> Any:
            return change(super().identify())

    return Driver


class Slow(TextLine):
    timeout_s = 5.0


class LastValue(TextLine):
    # A faulty sensor driver that returns the last value if the instrument does not answer.

    errors: tuple[type[Exception], ...] = (InstrumentTimeout,)
    last: SensorReading | None = None

    def read(self) -> SensorReading:
        try:
            self.last = super().read()
        except self.errors:
            if self.last is None:
                raise
        assert self.last is not None
        return self.last


class LastValueAfterACut(LastValue):
    errors = (InstrumentDisconnected,)


class LastValueForGarbage(LastValue):
    errors = (Exception,)


class Offended(TextLine):
    # A faulty sensor driver that reads no more values after one error.

    failed: Exception | None = None

    def read(self) -> SensorReading:
        if self.failed:
            raise self.failed
        try:
            return super().read()
        except Exception as error:
            self.failed = error
            raise


class KeepsLateAnswers(TextLine):
    # A faulty sensor driver that uses the late answer to one query as the answer to the next query.

    late: SensorReading | None = None

    def read(self) -> SensorReading:
        if self.late:
            late, self.late = self.late, None
            return late
        try:
            return super().read()
        except InstrumentTimeout:
            self._clock.sleep(1.0)
            self.late = self._reading(1.0, "mT")
            raise


class Hasty(TextLine):
    # A faulty sensor driver that waits only 0.1 s for an answer.

    timeout_s = 0.1


class RaisesAnything(TextLine):
    # A faulty sensor driver that raises RuntimeError instead of an InstrumentError.

    def read(self) -> SensorReading:
        try:
            return super().read()
        except Exception as error:
            raise RuntimeError(str(error)) from None


class ClosesOnce(TextLine):
    closed = False

    def close(self) -> None:
        if self.closed:
            raise RuntimeError("closed already")
        self.closed = True
        super().close()


class CrashesWhenClosed(TextLine):
    closed = False

    def close(self) -> None:
        self.closed = True
        super().close()

    def read(self) -> SensorReading:
        if self.closed:
            raise RuntimeError("closed")
        return super().read()


BAD: list[tuple[str, type]] = [
    ("states_its_identity", identified_as(lambda identity: identity.text)),
    ("states_its_identity", identified_as(lambda identity: replace(identity, text=""))),
    ("states_its_identity", identified_as(lambda identity: replace(identity, driver=""))),
    ("states_its_identity", identified_as(lambda identity: replace(identity, address="elsewhere"))),
    ("states_its_identity", Slow),
    ("reads_values_of_either_sign", reading_differently(lambda reading: reading.value)),
    ("reads_values_of_either_sign", reading_differently(lambda reading: replace(reading, unit="T"))),
    ("reads_values_of_either_sign", reading_differently(lambda reading: replace(reading, value=1.01 * reading.value))),
    ("reads_values_of_either_sign", reading_differently(lambda reading: replace(reading, value=-reading.value))),
    ("reads_values_of_either_sign", reading_differently(lambda reading: replace(reading, time_s=reading.time_s - 1))),
    ("reads_values_of_either_sign", reading_differently(lambda reading: replace(reading, time_s=reading.time_s + 1))),
    (
        "reads_values_of_either_sign",
        reading_differently(lambda reading: replace(reading, standard_uncertainty=-0.1)),
    ),
    (
        "reads_values_of_either_sign",
        reading_differently(lambda reading: replace(reading, standard_uncertainty=float("nan"))),
    ),
    ("gives_up_on_a_silent_line", LastValue),
    ("gives_up_on_a_silent_line", Offended),
    ("gives_up_on_a_silent_line", RaisesAnything),
    ("gives_up_on_a_silent_line", Slow),
    ("understands_no_garbage", LastValueForGarbage),
    ("understands_no_garbage", Offended),
    ("understands_no_garbage", RaisesAnything),
    ("takes_no_late_answer_for_the_next", KeepsLateAnswers),
    ("takes_no_late_answer_for_the_next", Hasty),
    ("reports_a_cut_line", LastValueAfterACut),
    ("reports_a_cut_line", RaisesAnything),
    ("closes_twice", ClosesOnce),
    ("closes_twice", CrashesWhenClosed),
]


def test_every_check_has_a_bad_driver() -> None:
    assert {name for name, _ in BAD} == {check.__name__ for check in SENSOR_CHECKS}


@pytest.mark.parametrize(("name", "driver"), BAD, ids=[f"{name}-{k}" for k, (name, _) in enumerate(BAD)])
def test_a_bad_driver_fails_its_check(name: str, driver: type) -> None:
    checks = [check for check in SENSOR_CHECKS if check.__name__ == name]
    check_sensor(TextLine, TextLineDialect, checks=checks)
    with pytest.raises(AssertionError, match=name):
        check_sensor(driver, TextLineDialect, checks=checks)
