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
    """Wrapper of the function that is called between two messages; the wrapper stores the error of the function.

    The function may raise an error in order to interrupt a call of the supply. The error then passes through the driver
    of another package. With `raised`, the caller can distinguish it from an error of the driver.

    Parameters
    ----------
    between_messages : callable
        The function that is called, without arguments, between two messages.
    """

    def __init__(self, between_messages: Callable[[], None]) -> None:
        self._between_messages = between_messages
        self._last: BaseException | None = None

    def __call__(self) -> None:
        """Call the given function; remember its error, if it raises one, and raise it again."""
        try:
            self._between_messages()
        except BaseException as error:
            self._last = error
            raise

    def raised(self, error: BaseException) -> bool:
        """Return whether `error` comes from the given function, and not from the driver of the supply."""
        return error is self._last


class ForeignSupply:
    """Wrapper of another package's supply, which raises the errors of the package's driver as InstrumentError.

    The caller of `open_supply` may give a function that is called between two messages, for example to stop a run.
    Three kinds of errors are raised unchanged: an InstrumentError, an error of this function, and an error that is not
    a subclass of `Exception`, such as KeyboardInterrupt. An error in `safe_off` is raised as SwitchOffFailed.

    Parameters
    ----------
    supply : PowerSupply
        The open supply.
    name : str
        The name of the driver, for messages.
    address : str
        The address, for messages.
    interruptions : Interruptions, optional
        The function that is called between two messages. None if there is no such function.
    """

    def __init__(
        self, supply: PowerSupply, name: str, address: str, interruptions: Interruptions | None = None
    ) -> None:
        self._supply = supply
        self._where = f"{name} supply {address}"
        self._interruptions = interruptions
        self.limits: Limits = supply.limits

    def __getattr__(self, member: str) -> Any:
        """Return an optional member of the wrapped supply, such as the text `without_contact`.

        Raises AttributeError if the wrapped supply has no such member.
        """
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
            The measured current and the largest current with which the supply counts as off. None if the driver does
            not measure the current in this call.

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
                f"{self._where}: its driver returned {answer!r} from {member}; it should return a {kind.__name__}"
            )
        return answer
