"""A supply in constant current with a coil on it, without any command language."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from eimi_drivers.interfaces import Clock, Reading

COPPER_PER_K = 0.00393
"""Temperature coefficient of the resistance of annealed copper at 20 °C (IEC 60028)."""

HUNTING_HZ = 0.7
LEAST_A = 1e-12  # below this the current has come to rest: no meter answers 1E-200


@dataclass(frozen=True)
class SupplyState:
    """Everything that a command can change.

    set_current_A, set_voltage_V: the set-points. armed: over-current protection acts at the current set-point.
    trip_current_A, trip_voltage_V: protections with levels of their own. tripped: one of them has acted.
    coil_current_A, heating_K, at_s: the coil's current and its temperature above that of the room when the
    state came to be, and the clock's time then.
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
    """A supply that feeds a copper coil of resistance R and inductance L through its regulator.

    The current tends to min(set-point, voltage set-point / R) while the output is on and to zero otherwise,
    as 1 - exp(-t/τ) with τ = L/R: computed from the clock when somebody asks, so that no thread is needed. The
    voltage shown is R I + L dI/dt. Readings carry normal noise from a generator with a seed; the true current
    does not. As on a bench supply, both set-points are zero at first, and over-current protection, where it is
    armed, trips when the current reaches its set-point.

    The coil warms up by thermal_resistance_K_per_W times R I² with the time constant thermal_time_constant_s
    (first order, R taken cold in the heating), and its resistance grows as copper's does.

    Things that go wrong: `locked`, somebody holds the front panel and no setter is obeyed; `hunting_A`, the current
    swings by so much and never settles; `shorted_A`, the regulator is shorted and so much flows whatever is set, also
    with the output off, while set-point and output read back as they were set; `drift`, the current departs from its
    set-point; `fallen`, no current flows although the output says that it is on; `trip`. `offset_A` is what the meter
    adds to every current.
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
        """The clock that the coil's current follows."""
        return self._clock

    def coil_current_A(self) -> float:
        """The true current in the coil now, A, without noise."""
        energised = self.state.output and self.state.set_current_A
        swing_A = self.hunting_A * math.sin(2 * math.pi * HUNTING_HZ * self._clock.now()) if energised else 0.0
        current_A = 0.0 if self.fallen else self._settling_current_A() + swing_A
        if energised and self._drift_A_per_s:
            drifting_s = self._clock.now() - self._drift_began_s
            current_A = max(current_A, min(current_A + self._drift_A_per_s * drifting_s, self._drift_to_A))
        return max(current_A, self.shorted_A) if self.shorted_A else current_A

    def heating_K(self) -> float:
        """How much warmer than the room the coil is now, K."""
        target_W = self._cold_ohm * self._target_A(self._cold_ohm) ** 2
        final_K = self._thermal_K_per_W * target_W
        return final_K + (self.state.heating_K - final_K) * math.exp(-self._age_s() / self._thermal_time_constant_s)

    def resistance_ohm(self) -> float:
        """The coil's resistance at its present temperature, ohm."""
        return self._cold_ohm * (1 + COPPER_PER_K * self.heating_K())

    def read(self) -> Reading:
        """What the supply's own meters show: true values and noise."""
        self._protect()
        current_noise_A, voltage_noise_V = self._noise
        return Reading(
            current_A=self.coil_current_A() + self.offset_A + self._random.normal(0.0, current_noise_A),
            voltage_V=self._voltage_V() + self._random.normal(0.0, voltage_noise_V),
        )

    def set_current(self, current_A: float) -> bool:
        """Take a current set-point; False, and no change, when the supply cannot do it or is locked."""
        lowest = -self.max_current_A if self.bipolar else 0.0
        return lowest <= current_A <= self.max_current_A and self._obey(set_current_A=current_A)

    def set_voltage(self, voltage_V: float) -> bool:
        """Take a voltage set-point; False, and no change, when the supply cannot do it or is locked."""
        return 0.0 <= voltage_V <= self.max_voltage_V and self._obey(set_voltage_V=voltage_V)

    def switch(self, on: bool) -> bool:
        """Switch the output, unless locked; switching on clears a trip."""
        return self._obey(output=on, tripped=self.state.tripped and not on)

    def arm(self, armed: bool) -> bool:
        """Arm over-current protection at the current set-point or disarm it, unless locked."""
        return self._obey(armed=armed)

    def set_trip_levels(self, *, current_A: float | None = None, voltage_V: float | None = None) -> bool:
        """Set the levels of protections that have their own, unless locked; None leaves one as it is."""
        state = self.state
        return self._obey(
            trip_current_A=state.trip_current_A if current_A is None else current_A,
            trip_voltage_V=state.trip_voltage_V if voltage_V is None else voltage_V,
        )

    def clear_trip(self) -> bool:
        """Forget a trip, unless locked; the output stays off."""
        return self._obey(tripped=False)

    def drift(self, to_A: float, rate_A_per_s: float = 1.0) -> None:
        """Let the current rise to `to_A` at this rate from now on, as long as the output is on; a rate of 0 ends it."""
        self._drift_to_A, self._drift_A_per_s, self._drift_began_s = to_A, rate_A_per_s, self._clock.now()

    def trip(self) -> None:
        """Let a protection switch the output off, whatever the reason."""
        self._change(output=False, tripped=True)

    def output_on(self) -> bool:
        """Whether the output is on."""
        self._protect()
        return self.state.output

    def constant_voltage(self) -> bool:
        """Whether the voltage set-point, not the current set-point, bounds the current."""
        return self.state.set_voltage_V < abs(self.state.set_current_A) * self.resistance_ohm()

    def _age_s(self) -> float:
        return max(self._clock.now() - self.state.at_s, 0.0)

    def _settling_current_A(self) -> float:
        target_A = self._target_A(self.resistance_ohm())
        left_A = (self.state.coil_current_A - target_A) * math.exp(-self._age_s() / self._time_constant_s)
        return target_A + (left_A if abs(left_A) > LEAST_A else 0.0)

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
