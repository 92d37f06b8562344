"""A driver that lacks a method or an attribute, or cannot be called, is refused with an explanation."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import pytest

from eimi_drivers import contract
from eimi_drivers.interfaces import Camera, PowerSupply, Sensor, UnusableDriver

KINDS: dict[str, tuple[type, Callable[..., None], Callable[..., None], int]] = {
    "supply": (PowerSupply, contract.check_supply_driver, contract.check_supply, 3),
    "camera": (Camera, contract.check_camera_driver, contract.check_camera, 2),
    "sensor": (Sensor, contract.check_sensor_driver, contract.check_sensor, 2),
}


def methods(protocol: type) -> dict[str, Callable[..., Any]]:
    return {name: f for name, f in vars(protocol).items() if inspect.isfunction(f) and not name.startswith("_")}


def made(kind: str, **members: Any) -> Any:
    # Return a complete driver class of a kind (supply, camera or sensor), changed by `members`.
    # members : other attributes and methods; None: the member is absent
    protocol, _, _, count = KINDS[kind]
    body: dict[str, Any] = dict(methods(protocol))
    body["__init__"] = {2: lambda self, a, b: None, 3: lambda self, a, b, c: None}[count]
    body |= dict.fromkeys(protocol.__annotations__)
    body |= members
    return type(
        "Mine", (), {name: member for name, member in body.items() if member is not None or name not in members}
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_driver_with_every_member_is_accepted_as_a_class_and_as_a_function(kind: str) -> None:
    _, check_driver, check_opened, count = KINDS[kind]
    driver = made(kind)
    check_driver("mine", driver)
    check_opened("mine", driver, driver(*range(count)))
    check_driver("mine", (lambda a, b: None) if count == 2 else (lambda a, b, c: None))
    check_driver("mine", lambda *arguments: None)


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in KINDS for name in methods(KINDS[kind][0])])
def test_each_missing_member_is_named_before_and_after_opening(kind: str, name: str) -> None:
    protocol, check_driver, check_opened, count = KINDS[kind]
    does = str(vars(protocol)[name].__doc__).splitlines()[0]
    driver = made(kind, **{name: None})
    for check in (check_driver, lambda *given: check_opened(*given, driver(*range(count)))):
        with pytest.raises(UnusableDriver) as caught:
            check("mine", driver)
        words = str(caught.value)
        assert words.startswith(f"the {kind} driver 'mine' (tests.drivers.test_driver_contract.Mine) cannot be used: ")
        assert f"{name} is missing (needed: {name}(" in words
        assert does in words


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in KINDS for name in methods(KINDS[kind][0])])
def test_each_member_that_cannot_be_called_is_named_with_its_arguments(kind: str, name: str) -> None:
    _, check_driver, check_opened, count = KINDS[kind]
    for wrong, words in (
        (5, f"{name} is 5, but should be {name}("),
        (lambda self, a, b, c, d: None, rf"{name} is called as {name}\(.*a, b, c, d\), but should be {name}\("),
    ):
        driver = made(kind, **{name: wrong})
        with pytest.raises(UnusableDriver, match=words if "called" in words else None) as caught:
            check_driver("mine", driver)
        assert "called" in words or words in str(caught.value)
        if name != "close":
            with pytest.raises(UnusableDriver):
                check_opened("mine", driver, driver(*range(count)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_driver_that_cannot_be_called_with_its_arguments_is_refused(kind: str) -> None:
    _, check_driver, _, count = KINDS[kind]
    for driver in (made(kind, __init__=lambda self: None), lambda: None, lambda *, key: None):
        with pytest.raises(UnusableDriver, match=r"is called as .* but should be "):
            check_driver("mine", driver)
    with pytest.raises(UnusableDriver, match="is 5, but should be "):
        check_driver("mine", 5)
    assert count in (2, 3)


@pytest.mark.parametrize("kind", ["supply", "sensor"])
def test_a_connect_method_is_called_with_the_address_only(kind: str) -> None:
    _, check_driver, _, _ = KINDS[kind]
    check_driver("mine", made(kind, connect=staticmethod(lambda address: None)))
    for connect in (lambda: None, lambda a, b: None):
        with pytest.raises(UnusableDriver, match=r"connect cannot be called as connect\(address\)"):
            check_driver("mine", made(kind, connect=staticmethod(connect)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fails", [False, True])
def test_an_open_instrument_that_lacks_a_member_is_closed(kind: str, fails: bool) -> None:
    _, _, check_opened, count = KINDS[kind]
    closed: list[object] = []

    def close(self: object) -> None:
        closed.append(self)
        if fails:
            raise RuntimeError("stuck")

    driver = made(kind, identify=None, close=close)
    instrument = driver(*range(count))
    with pytest.raises(UnusableDriver, match="identify is missing"):
        check_opened("mine", driver, instrument)
    assert closed == [instrument]
    complete = made(kind, close=close)(*range(count))
    check_opened("mine", driver, complete)
    assert closed == [instrument]


@pytest.mark.parametrize("kind", ["supply", "sensor"])
def test_an_attribute_is_needed_from_the_open_instrument_only(kind: str) -> None:
    protocol, check_driver, check_opened, count = KINDS[kind]
    for name in protocol.__annotations__:
        driver = made(kind, **{name: None})
        check_driver("mine", driver)
        with pytest.raises(UnusableDriver, match=f"{name} is missing .needed: an attribute of type "):
            check_opened("mine", driver, driver(*range(count)))
