"""Raise every error of another package's supply driver as an InstrumentError with one line of text."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from eimi_drivers.interfaces import (
    Identity,
    InstrumentError,
    Limits,
    Off,
    PowerSupply,
    Reading,
    ReplyNotUnderstood,
    SwitchOffFailed,
    raised,
)

_Value = TypeVar("_Value")


class Interruptions:
    """A function that is called between two messages, and the last error that it raised.

    Parameters
    ----------
    between_messages : callable
        Function without arguments; it stops the driver by raising an error.
    """

    def __init__(self, between_messages: Callable[[], None]) -> None:
        self._between_messages = between_messages
        self._last: BaseException | None = None

    def __call__(self) -> None:
        """Call the function that can stop the driver; store and raise its error."""
        try:
            self._between_messages()
        except BaseException as error:
            self._last = error
            raise

    def raised(self, error: BaseException) -> bool:
        """Return whether `error` was raised to stop the driver, and not by the driver itself."""
        return error is self._last


class ForeignSupply:
    """A supply of another package, whose errors are raised as InstrumentError.

    An error of `safe_off` is raised as SwitchOffFailed.

    Parameters
    ----------
    supply : PowerSupply
        Open supply.
    name : str
        Name of the driver, for messages.
    address : str
        Address of the supply, for messages.
    interruptions : Interruptions, optional
        Function that can stop the driver between two messages; its errors are raised unchanged.
    """

    def __init__(
        self, supply: PowerSupply, name: str, address: str, interruptions: Interruptions | None = None
    ) -> None:
        self._supply = supply
        self._where = f"{name} supply {address}"
        self._interruptions = interruptions
        self.limits: Limits = supply.limits

    def __getattr__(self, member: str) -> Any:
        """Return an optional attribute or method of the supply; raise AttributeError if the supply does not have it."""
        try:
            return getattr(self._supply, member)
        except (AttributeError, InstrumentError):
            raise
        except Exception as error:
            raise InstrumentError(f"{self._where}: its driver raised {raised(error)} in {member}") from error

    def identify(self) -> Identity:
        """Return the identity that the supply reports."""
        return self._checked("identify", Identity, self._supply.identify)

    def set_voltage(self, voltage_V: float) -> None:
        """Set the compliance voltage (V) and verify the set-point."""
        self._call("set_voltage", lambda: self._supply.set_voltage(voltage_V))

    def set_current(self, current_A: float) -> None:
        """Set the current (A) and verify the set-point."""
        self._call("set_current", lambda: self._supply.set_current(current_A))

    def set_output(self, on: bool) -> None:
        """Switch the output on or off, and verify that the output has switched."""
        self._call("set_output", lambda: self._supply.set_output(on))

    def output_on(self) -> bool:
        """Return whether the supply reports that its output is on."""
        return bool(self._call("output_on", self._supply.output_on))

    def measure(self) -> Reading:
        """Return the measured output current (A) and output voltage (V)."""
        return self._checked("measure", Reading, self._supply.measure)

    def check(self) -> None:
        """Raise ProtectionTripped or InstrumentError if the supply reports a fault."""
        self._call("check", self._supply.check)

    def safe_off(self) -> Off | None:
        """Set the current to zero, switch the output off and verify both settings.

        Returns
        -------
        Off or None
            Measured current, and the largest current that counts as off; None if this driver does not measure it here.

        Raises
        ------
        SwitchOffFailed
            The driver raised any error.
        """
        try:
            return self._call("safe_off", self._supply.safe_off)
        except SwitchOffFailed:
            raise
        except InstrumentError as error:
            raise SwitchOffFailed(str(error)) from error

    def close(self) -> None:
        """Release the port without changing the output."""
        self._call("close", self._supply.close)

    def _call(self, member: str, act: Callable[[], _Value]) -> _Value:
        try:
            return act()
        except InstrumentError:
            raise
        except Exception as error:
            if self._interruptions is not None and self._interruptions.raised(error):
                raise
            raise InstrumentError(f"{self._where}: its driver raised {raised(error)} in {member}") from error

    def _checked(self, member: str, kind: type[_Value], act: Callable[[], _Value]) -> _Value:
        answer = self._call(member, act)
        if not isinstance(answer, kind):
            raise ReplyNotUnderstood(
                f"{self._where}: its driver returned {answer!r} from {member}; it should return a {kind.__name__}"
            )
        return answer
