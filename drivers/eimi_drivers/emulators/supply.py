"""Model a supply that feeds a coil with a constant current."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from eimi_drivers.interfaces import Clock, Reading

COPPER_PER_K = 0.00393
"""Temperature coefficient of the resistance of annealed copper at 20 °C (IEC 60028)."""

HUNTING_HZ = 0.7
"""Frequency (Hz) of the oscillation of the current whose amplitude is `CoilSupply.hunting_A`."""

LEAST_A = 1e-12
"""Smallest difference (A) from the final current. A smaller difference is set to 0, to avoid values such as 1E-200."""


@dataclass(frozen=True)
class SupplyState:
    """The settings of an emulated supply and the current in its coil at one time.

    Parameters
    ----------
    set_current_A, set_voltage_V : float
        The set-points of the current (A) and the voltage (V).
    output : bool
        True if the output is on.
    armed : bool
        True if the over-current protection is on.
    tripped : bool
        True if a protection has switched the output off.
    coil_current_A : float
        The current in the coil, A.
    at_s : float
        The time on the clock of the supply, s.
    trip_current_A, trip_voltage_V : float
        The current (A) and the voltage (V) above which a protection switches the output off; infinite for none.
    heating_K : float
        The temperature of the coil above the temperature of the room, K.
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
    """Model of a supply that feeds a copper coil of resistance R and inductance L.

    At the time t after a change of the set-point, the current is I = I₁ + (I₀ - I₁) exp(-t/τ), where I₀ is the current
    at the change, I₁ the final current, and τ = L/R the time constant. The voltage is R I + L dI/dt. Measured values
    have normally distributed noise.

    Parameters
    ----------
    clock : Clock
        The clock of the supply and the coil.
    resistance_ohm : float
        The resistance of the cold coil, ohm.
    time_constant_s : float
        The time constant τ of the current, s.
    current_noise_A, voltage_noise_V : float
        The standard deviations of the measured current (A) and voltage (V).
    seed : int
        The seed of the noise.
    max_current_A, max_voltage_V : float
        The largest set-points of current (A) and voltage (V) that the supply accepts.
    thermal_resistance_K_per_W : float
        The final heating of the coil divided by the power, K/W.
    thermal_time_constant_s : float
        The time constant of the heating, s.

    Attributes
    ----------
    bipolar : bool
        True if negative currents can be set.
    locked : bool
        True if a person uses the front panel. The supply then obeys no command.
    hunting_A : float
        The amplitude of a permanent oscillation of the current, A.
    shorted_A : float
        The current through a shorted regulator, A, which flows at any set-point and even if the output is off.
    offset_A : float
        The error that the meter adds to every current, A.
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
        """Return the clock of the supply and the coil."""
        return self._clock

    def coil_current_A(self) -> float:
        """Return the present true current in the coil, A."""
        energised = self.state.output and self.state.set_current_A
        swing_A = self.hunting_A * math.sin(2 * math.pi * HUNTING_HZ * self._clock.now()) if energised else 0.0
        current_A = 0.0 if self.fallen else self._settling_current_A() + swing_A
        if energised and self._drift_A_per_s:
            drifting_s = self._clock.now() - self._drift_began_s
            current_A = max(current_A, min(current_A + self._drift_A_per_s * drifting_s, self._drift_to_A))
        return max(current_A, self.shorted_A) if self.shorted_A else current_A

    def coil_current_at_A(self, time_s: float) -> float:
        """Return the true current in the coil at a past time, A.

        For a time before the last change of a set-point, the result is the current at this change.
        """
        if time_s < self.state.at_s:
            return self.state.coil_current_A
        return self._settling_current_A(time_s - self.state.at_s) if self._is_plain() else self.coil_current_A()

    def _is_plain(self) -> bool:
        return not (self.hunting_A or self.fallen or self._drift_A_per_s or self.shorted_A)

    def heating_K(self) -> float:
        """Return the present temperature of the coil above the temperature of the room, K."""
        target_W = self._cold_ohm * self._target_A(self._cold_ohm) ** 2
        final_K = self._thermal_K_per_W * target_W
        return final_K + (self.state.heating_K - final_K) * math.exp(-self._age_s() / self._thermal_time_constant_s)

    def resistance_ohm(self) -> float:
        """Return the resistance of the coil at its present temperature, ohm."""
        return self._cold_ohm * (1 + COPPER_PER_K * self.heating_K())

    def read(self) -> Reading:
        """Return the current (A) and the voltage (V) that the supply measures, with offset and noise."""
        self._protect()
        current_noise_A, voltage_noise_V = self._noise
        return Reading(
            current_A=self.coil_current_A() + self.offset_A + self._random.normal(0.0, current_noise_A),
            voltage_V=self._voltage_V() + self._random.normal(0.0, voltage_noise_V),
        )

    def set_current(self, current_A: float) -> bool:
        """Set the current (A), and return whether the supply accepted the value."""
        lowest = -self.max_current_A if self.bipolar else 0.0
        return lowest <= current_A <= self.max_current_A and self._obey(set_current_A=current_A)

    def set_voltage(self, voltage_V: float) -> bool:
        """Set the voltage (V), and return whether the supply accepted the value."""
        return 0.0 <= voltage_V <= self.max_voltage_V and self._obey(set_voltage_V=voltage_V)

    def switch(self, on: bool) -> bool:
        """Switch the output on or off, and return whether the supply obeyed. Switching on clears a trip."""
        return self._obey(output=on, tripped=self.state.tripped and not on)

    def arm(self, armed: bool) -> bool:
        """Switch the over-current protection on or off, and return whether the supply obeyed."""
        return self._obey(armed=armed)

    def set_trip_levels(self, *, current_A: float | None = None, voltage_V: float | None = None) -> bool:
        """Set the trip levels of current (A) and voltage (V), and return whether the supply obeyed.

        None leaves a value unchanged.
        """
        state = self.state
        return self._obey(
            trip_current_A=state.trip_current_A if current_A is None else current_A,
            trip_voltage_V=state.trip_voltage_V if voltage_V is None else voltage_V,
        )

    def clear_trip(self) -> bool:
        """Clear the trip of a protection, and return whether the supply obeyed. The output stays off."""
        return self._obey(tripped=False)

    def drift(self, to_A: float, rate_A_per_s: float = 1.0) -> None:
        """Begin the fault that lets the current rise to `to_A` (A) at `rate_A_per_s` (A/s) while the output is on.

        The rate 0 ends the fault.
        """
        self._drift_to_A, self._drift_A_per_s, self._drift_began_s = to_A, rate_A_per_s, self._clock.now()

    def trip(self) -> None:
        """Switch the output off as a protection does, and mark the protection as tripped."""
        self._change(output=False, tripped=True)

    def reset(self, current_A: float = 0.0) -> bool:
        """Switch the output off, set 0 V and `current_A`, and clear a trip, as ``*RST`` does.

        Return whether the supply obeyed.
        """
        return self._obey(output=False, set_voltage_V=0.0, set_current_A=current_A, tripped=False)

    def restart(self) -> None:
        """Switch the output off, set 0 V and 0 A, and switch the protections off, as after power-up."""
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
        """Return whether the output is on, after the protections have been checked."""
        self._protect()
        return self.state.output

    def constant_voltage(self) -> bool:
        """Return whether the supply limits the voltage, so that the current does not reach its set-point."""
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
