"""Turn every error of another package's driver into an InstrumentError with one line of text."""

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
    """Call the function of `open_supply` between messages, and remember the errors that the function raises.

    These errors are not errors of the driver.

    Parameters
    ----------
    between_messages : callable
        The function. It may raise an error to interrupt a call of the supply.
    """

    def __init__(self, between_messages: Callable[[], None]) -> None:
        self._between_messages = between_messages
        self._last: BaseException | None = None

    def __call__(self) -> None:
        """Call the function."""
        try:
            self._between_messages()
        except BaseException as error:
            self._last = error
            raise

    def raised(self, error: BaseException) -> bool:
        """Return whether the function raised this error."""
        return error is self._last


class ForeignSupply:
    """Call a supply of another package, and raise the errors of its driver as InstrumentError.

    Errors of `eimi_drivers.interfaces`, interruptions between two messages, and exceptions that are no `Exception` pass
    unchanged. An error in `safe_off` becomes SwitchOffFailed.

    Parameters
    ----------
    supply : PowerSupply
        The open supply.
    name : str
        The name of the driver, for messages.
    address : str
        The address, for messages.
    interruptions : Interruptions, optional
        The function that is called between two messages.
    """

    def __init__(
        self, supply: PowerSupply, name: str, address: str, interruptions: Interruptions | None = None
    ) -> None:
        self._supply = supply
        self._where = f"{name} supply {address}"
        self._interruptions = interruptions
        self.limits: Limits = supply.limits

    def __getattr__(self, member: str) -> Any:
        """Return another member of the supply, such as `without_contact`. Raises AttributeError if it has none."""
        try:
            return getattr(self._supply, member)
        except (AttributeError, InstrumentError):
            raise
        except Exception as error:
            raise InstrumentError(f"{self._where}: its driver raised {raised(error)} in {member}") from error

    def identify(self) -> Identity:
        """Ask the instrument for its identity."""
        return self._checked("identify", Identity, self._supply.identify)

    def set_voltage(self, voltage_V: float) -> None:
        """Set the compliance voltage and read it back."""
        self._call("set_voltage", lambda: self._supply.set_voltage(voltage_V))

    def set_current(self, current_A: float) -> None:
        """Set the current and read the set-point back."""
        self._call("set_current", lambda: self._supply.set_current(current_A))

    def set_output(self, on: bool) -> None:
        """Switch the output and verify it."""
        self._call("set_output", lambda: self._supply.set_output(on))

    def output_on(self) -> bool:
        """Ask the instrument whether its output is on."""
        return bool(self._call("output_on", self._supply.output_on))

    def measure(self) -> Reading:
        """Measure the output."""
        return self._checked("measure", Reading, self._supply.measure)

    def check(self) -> None:
        """Raise ProtectionTripped or InstrumentError if the instrument reports a fault."""
        self._call("check", self._supply.check)

    def safe_off(self) -> Off | None:
        """Set zero current, switch off and verify. Raises SwitchOffFailed for every error."""
        try:
            return self._call("safe_off", self._supply.safe_off)
        except SwitchOffFailed:
            raise
        except InstrumentError as error:
            raise SwitchOffFailed(str(error)) from error

    def close(self) -> None:
        """Release the port and leave the output as it is."""
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
                f"{self._where}: its driver returned {answer!r} from {member}, but should return a {kind.__name__}"
            )
        return answer
