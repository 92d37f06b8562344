"""Check the bounds of the readings during a run. If a reading leaves its bounds or is missing, the run ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from eimi_drivers.interfaces import InstrumentError, Reading
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import InterlockOpened, OnEvent, ignore_event
from eimi_lab.config.interlock import READINGS, Interlock


class BeyondInterlock(InstrumentError):
    """The error that is raised if a reading is missing or outside its bounds in the rig file."""


def readings_of(measured: Reading) -> dict[str, float]:
    """Return the values of a measurement of the supply by their names in the rig file."""
    return {name: reading(measured) for name, reading in READINGS.items()}


class Interlocks:
    """The bounds of the readings of a run. A reading outside its bounds ends the run.

    Parameters
    ----------
    rules : sequence of Interlock
        The bounds in the rig file.
    on_event : callable
        Receives an `InterlockOpened` if a reading leaves its bounds or is missing.
    """

    def __init__(self, rules: Sequence[Interlock] = (), on_event: OnEvent = ignore_event) -> None:
        self._rules = tuple(rules)
        self._on_event = on_event
        self._came_s: dict[str, float] = {}

    def __bool__(self) -> bool:
        return bool(self._rules)

    def hold(self, readings: Mapping[str, float]) -> bool:
        """Return whether all readings (values by name) are within their bounds. A missing value counts as within."""
        return all(_is_within(rule, readings[rule.reading]) for rule in self._rules if rule.reading in readings)

    def check(self, readings: Mapping[str, float], now_s: float) -> None:
        """Raise BeyondInterlock if a reading is outside its bounds, and record the time of the readings.

        `readings` contains the values by name; `now_s` is their time on the clock of the run (s).
        """
        for rule in self._rules:
            if rule.reading in readings:
                self._came_s[rule.reading] = now_s
                value = readings[rule.reading]
                if not _is_within(rule, value):
                    self._open(rule, value, None)

    def check_silence(self, now_s: float) -> None:
        """Raise BeyondInterlock if a reading gave no new value for longer than `longest_silence_s`.

        `now_s` is the present time on the clock of the run (s). Without a value, the time counts from the first call.
        """
        for rule in self._rules:
            silent_s = now_s - self._came_s.setdefault(rule.reading, now_s)
            if silent_s > rule.longest_silence_s:
                self._open(rule, None, silent_s)

    def restart(self) -> None:
        """Forget the times of all earlier readings."""
        # No readings were taken while the output was off, and this silence must not end the run.
        self._came_s.clear()

    def refuse_to_begin(self, readings: Mapping[str, float]) -> None:
        """Raise BeyondInterlock before a run if one of the readings is missing or outside its bounds."""
        for rule in self._rules:
            value = readings.get(rule.reading)
            if value is None or not _is_within(rule, value):
                self._open(rule, value, None)

    def _open(self, rule: Interlock, value: float | None, silent_s: float | None) -> None:
        event = InterlockOpened(
            reading=rule.reading,
            value=value,
            minimum=rule.minimum,
            maximum=rule.maximum,
            silent_s=silent_s,
            longest_silence_s=rule.longest_silence_s,
        )
        self._on_event(event)
        raise BeyondInterlock(in_words(event))


def _is_within(rule: Interlock, value: float) -> bool:
    """Return whether a value is within its bounds; NaN is outside."""
    if rule.minimum is not None and not value >= rule.minimum:
        return False
    return rule.maximum is None or value <= rule.maximum
