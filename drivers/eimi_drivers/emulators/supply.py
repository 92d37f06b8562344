"""Model a supply that drives a coil with constant current, without a command language."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from eimi_drivers.interfaces import Clock, Reading

COPPER_PER_K = 0.00393
"""Temperature coefficient of the resistance of annealed copper at 20 °C (IEC 60028)."""

HUNTING_HZ = 0.7
"""Frequency (Hz) of the swings of `CoilSupply.hunting_A`."""

LEAST_A = 1e-12
"""A smaller difference (A) from the final current counts as zero, so that no meter answers 1E-200."""


@dataclass(frozen=True)
class SupplyState:
    """Hold everything that a command can change.

    Parameters
    ----------
    set_current_A, set_voltage_V : float
        The set-points.
    output : bool
        True if the output is on.
    armed : bool
        True if over-current protection trips at the current set-point.
    tripped : bool
        True if a protection has switched the output off.
    coil_current_A, at_s : float
        The coil's current (A) when this state began, and the clock's time (s) then.
    trip_current_A, trip_voltage_V : float
        The levels of the protections that have their own.
    heating_K : float
        The temperature of the coil above the room (K) when this state began.
    """

    set_current_A: float = 0.0
    set_voltage_V: float = 0.0
    output: bool = False
    armed: bool = False
    tripped: bool = False
    coil_current_A: float = 0.0
    at_s: float = 0.0
    trip_current_A: float = math.inf
    trip_voltage_V: float = math.inf
    heating_K: float = 0.0


class CoilSupply:
    """Model a supply that feeds a copper coil of resistance R and inductance L through its regulator.

    While the output is on, the current I tends to min(set-point, voltage set-point / R), otherwise to zero. It follows
    1 - exp(-t/τ) with τ = L/R. It is computed from the clock on demand, so that no thread is needed. The voltage is
    R I + L dI/dt. Readings have normal noise from a seeded generator; the true current has none. As on a bench supply,
    both set-points are zero at first. Over-current protection, if armed, trips when the current reaches its set-point.

    The coil warms up by `thermal_resistance_K_per_W` times R I², with a first-order time constant. R is the cold
    resistance in this product. The resistance grows with the temperature like the resistance of copper.

    Parameters
    ----------
    clock : Clock
        The clock that the current follows.
    resistance_ohm, time_constant_s : float
        The cold resistance R and the time constant τ.
    current_noise_A, voltage_noise_V : float
        The standard deviations of the readings.
    seed : int
        The seed of the noise.
    max_current_A, max_voltage_V : float
        The largest set-points that the supply accepts.
    thermal_resistance_K_per_W, thermal_time_constant_s : float
        The heating per power, and its time constant.

    Attributes
    ----------
    bipolar : bool
        True if negative currents can be set.
    locked : bool
        True if a person uses the front panel: no command is obeyed.
    hunting_A : float
        The amplitude of an oscillation of the current that never ends.
    shorted_A : float
        The current through a shorted regulator, at any set-point and even if the output is off. Set-points and output
        read back as they were set.
    offset_A : float
        The error that the meter adds to every current.
    fallen : bool
        True if no current flows although the output reads back as on.
    """

    def __init__(
        self,
        clock: Clock,
        *,
        resistance_ohm: float = 4.0,
        time_constant_s: float = 0.05,
        current_noise_A: float = 0.0,
        voltage_noise_V: float = 0.0,
        seed: int = 0,
        max_current_A: float = 5.0,
        max_voltage_V: float = 30.0,
        thermal_resistance_K_per_W: float = 0.0,
        thermal_time_constant_s: float = 600.0,
    ) -> None:
        if not (resistance_ohm > 0 and time_constant_s > 0 and thermal_time_constant_s > 0):
            raise ValueError("resistance_ohm, time_constant_s and thermal_time_constant_s must be greater than 0")
        self.state = SupplyState(at_s=clock.now())
        self.max_current_A = max_current_A
        self.max_voltage_V = max_voltage_V
        self.bipolar = False
        self.locked = False
        self.hunting_A = self.shorted_A = self.offset_A = 0.0
        self.fallen = False
        self._drift_A_per_s = self._drift_began_s = self._drift_to_A = 0.0
        self._clock = clock
        self._cold_ohm = resistance_ohm
        self._time_constant_s = time_constant_s
        self._thermal_K_per_W = thermal_resistance_K_per_W
        self._thermal_time_constant_s = thermal_time_constant_s
        self._noise = (current_noise_A, voltage_noise_V)
        self._random = np.random.default_rng(seed)

    @property
    def clock(self) -> Clock:
        """Return the clock that the coil's current follows."""
        return self._clock

    def coil_current_A(self) -> float:
        """Return the true current (A) in the coil now, without noise."""
        energised = self.state.output and self.state.set_current_A
        swing_A = self.hunting_A * math.sin(2 * math.pi * HUNTING_HZ * self._clock.now()) if energised else 0.0
        current_A = 0.0 if self.fallen else self._settling_current_A() + swing_A
        if energised and self._drift_A_per_s:
            drifting_s = self._clock.now() - self._drift_began_s
            current_A = max(current_A, min(current_A + self._drift_A_per_s * drifting_s, self._drift_to_A))
        return max(current_A, self.shorted_A) if self.shorted_A else current_A

    def coil_current_at_A(self, time_s: float) -> float:
        """Return the true current (A) at a past time; for a time before the last change, the current at that change."""
        if time_s < self.state.at_s:
            return self.state.coil_current_A
        return self._settling_current_A(time_s - self.state.at_s) if self._is_plain() else self.coil_current_A()

    def _is_plain(self) -> bool:
        return not (self.hunting_A or self.fallen or self._drift_A_per_s or self.shorted_A)

    def heating_K(self) -> float:
        """Return the temperature of the coil above the room now, K."""
        target_W = self._cold_ohm * self._target_A(self._cold_ohm) ** 2
        final_K = self._thermal_K_per_W * target_W
        return final_K + (self.state.heating_K - final_K) * math.exp(-self._age_s() / self._thermal_time_constant_s)

    def resistance_ohm(self) -> float:
        """Return the coil's resistance at its present temperature, ohm."""
        return self._cold_ohm * (1 + COPPER_PER_K * self.heating_K())

    def read(self) -> Reading:
        """Return the readings of the supply's own meters: true values, offset and noise."""
        self._protect()
        current_noise_A, voltage_noise_V = self._noise
        return Reading(
            current_A=self.coil_current_A() + self.offset_A + self._random.normal(0.0, current_noise_A),
            voltage_V=self._voltage_V() + self._random.normal(0.0, voltage_noise_V),
        )

    def set_current(self, current_A: float) -> bool:
        """Take a current set-point; return False without a change if it is out of range or the supply is locked."""
        lowest = -self.max_current_A if self.bipolar else 0.0
        return lowest <= current_A <= self.max_current_A and self._obey(set_current_A=current_A)

    def set_voltage(self, voltage_V: float) -> bool:
        """Take a voltage set-point; return False without a change if it is out of range or the supply is locked."""
        return 0.0 <= voltage_V <= self.max_voltage_V and self._obey(set_voltage_V=voltage_V)

    def switch(self, on: bool) -> bool:
        """Switch the output, unless locked. Switching on clears a trip."""
        return self._obey(output=on, tripped=self.state.tripped and not on)

    def arm(self, armed: bool) -> bool:
        """Arm or disarm over-current protection at the current set-point, unless locked."""
        return self._obey(armed=armed)

    def set_trip_levels(self, *, current_A: float | None = None, voltage_V: float | None = None) -> bool:
        """Set the trip levels of current and voltage, unless they are locked; None leaves a level unchanged."""
        state = self.state
        return self._obey(
            trip_current_A=state.trip_current_A if current_A is None else current_A,
            trip_voltage_V=state.trip_voltage_V if voltage_V is None else voltage_V,
        )

    def clear_trip(self) -> bool:
        """Clear a trip, unless locked; the output stays off."""
        return self._obey(tripped=False)

    def drift(self, to_A: float, rate_A_per_s: float = 1.0) -> None:
        """Let the current rise to `to_A` at this rate while the output is on; a rate of 0 ends the drift."""
        self._drift_to_A, self._drift_A_per_s, self._drift_began_s = to_A, rate_A_per_s, self._clock.now()

    def trip(self) -> None:
        """Let a protection switch the output off."""
        self._change(output=False, tripped=True)

    def reset(self, current_A: float = 0.0) -> bool:
        """Switch off, set 0 V and this current, and clear a trip, unless locked (``*RST``)."""
        return self._obey(output=False, set_voltage_V=0.0, set_current_A=current_A, tripped=False)

    def restart(self) -> None:
        """Return to the state after power-up: output off, set-points 0, no protection levels."""
        self._change(
            output=False,
            set_voltage_V=0.0,
            set_current_A=0.0,
            tripped=False,
            armed=False,
            trip_current_A=math.inf,
            trip_voltage_V=math.inf,
        )

    def output_on(self) -> bool:
        """Return whether the output is on."""
        self._protect()
        return self.state.output

    def constant_voltage(self) -> bool:
        """Return whether the voltage set-point limits the current."""
        return self.state.set_voltage_V < abs(self.state.set_current_A) * self.resistance_ohm()

    def _age_s(self) -> float:
        return max(self._clock.now() - self.state.at_s, 0.0)

    def _settling_current_A(self, age_s: float | None = None) -> float:
        target_A, age_s = self._target_A(self.resistance_ohm()), self._age_s() if age_s is None else age_s
        remaining_A = (self.state.coil_current_A - target_A) * math.exp(-age_s / self._time_constant_s)
        return target_A + (remaining_A if abs(remaining_A) > LEAST_A else 0.0)

    def _target_A(self, resistance_ohm: float) -> float:
        if not self.state.output:
            return 0.0
        bound_A = self.state.set_voltage_V / resistance_ohm
        return max(-bound_A, min(self.state.set_current_A, bound_A))

    def _voltage_V(self) -> float:
        if not self.state.output:
            return 0.0
        resistance_ohm = self.resistance_ohm()
        inductance_H = self._time_constant_s * self._cold_ohm
        slope_A_per_s = (self._target_A(resistance_ohm) - self._settling_current_A()) / self._time_constant_s
        return resistance_ohm * self.coil_current_A() + inductance_H * slope_A_per_s

    def _protect(self) -> None:
        state = self.state
        if state.output and (
            (state.armed and abs(self.coil_current_A()) >= 0.99 * abs(state.set_current_A))
            or abs(self.coil_current_A()) > state.trip_current_A
            or abs(self._voltage_V()) > state.trip_voltage_V
        ):
            self.trip()

    def _obey(self, **values: float | bool) -> bool:
        if not self.locked:
            self._change(**values)
        return not self.locked

    def _change(self, **values: float | bool) -> None:
        self.state = replace(
            self.state,
            coil_current_A=self._settling_current_A(),
            heating_K=self.heating_K(),
            at_s=self._clock.now(),
            **values,  # type: ignore[arg-type]
        )
