"""Whether drivers and instruments have the members of `interfaces`; what is missing or wrong is named in one line."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any

from eimi_drivers.interfaces import Camera, CameraDriver, PowerSupply, SupplyDriver, UnusableDriver


def check_supply_driver(name: str, driver: object) -> None:
    """Raise UnusableDriver if a driver cannot be called as `SupplyDriver` says, or is a class that is no supply."""
    faults = [*_call_faults(_name(driver), driver, SupplyDriver.__call__)]
    if (connect := getattr(driver, "connect", None)) is not None and not _takes(connect, 1):
        faults.append("connect cannot be called as connect(address)")
    _raise("supply", name, driver, [*faults, *_class_faults(driver, PowerSupply)])


def check_camera_driver(name: str, driver: object) -> None:
    """Raise UnusableDriver if a driver cannot be called as `CameraDriver` says, or is a class that is no camera."""
    _raise(
        "camera",
        name,
        driver,
        [*_call_faults(_name(driver), driver, CameraDriver.__call__), *_class_faults(driver, Camera)],
    )


def check_supply(name: str, driver: object, supply: PowerSupply) -> None:
    """Raise UnusableDriver if what a driver opened is no supply; it is closed before."""
    _check_opened("supply", name, driver, supply, PowerSupply)


def check_camera(name: str, driver: object, camera: Camera) -> None:
    """Raise UnusableDriver if what a driver opened is no camera; it is closed before."""
    _check_opened("camera", name, driver, camera, Camera)


def _check_opened(kind: str, name: str, driver: object, instrument: PowerSupply | Camera, protocol: type) -> None:
    faults = dict(_faults(instrument, protocol))
    try:
        if faults and "close" not in faults:
            instrument.close()
    finally:  # what close() of half an instrument raises says less
        _raise(kind, name, driver, list(faults.values()))


def _raise(kind: str, name: str, driver: object, faults: list[str]) -> None:
    if faults:
        where = f"{getattr(driver, '__module__', '?')}.{_name(driver)}"
        raise UnusableDriver(f"the {kind} driver {name!r} ({where}) cannot be used: {'; '.join(faults)}")


def _name(driver: object) -> str:
    return str(getattr(driver, "__name__", type(driver).__name__))


def _class_faults(driver: object, protocol: type) -> Iterator[str]:
    """What can be said of a class before it is called; of a function nothing can."""
    if not inspect.isclass(driver):
        return
    for name in sorted(getattr(driver, "__abstractmethods__", ())):
        yield f"{name} is missing"
    for name, fault in _faults(driver, protocol):
        if name not in protocol.__annotations__:  # a value, which an instance alone has
            yield fault


def _faults(subject: object, protocol: type) -> Iterator[tuple[str, str]]:
    """The members of a protocol that an object or a class does not have as it should, with a line for each."""
    for name, kind in protocol.__annotations__.items():
        if not hasattr(subject, name):
            yield name, f"{name} is missing, which should be its {kind}"
    for name, member in vars(protocol).items():
        if name.startswith("_") or not inspect.isfunction(member):
            continue
        does = str(member.__doc__).splitlines()[0]
        if not hasattr(subject, name):
            yield name, f"{name} is missing, which should be {_called(name, member)}: {does}"
        else:
            yield from ((name, fault) for fault in _call_faults(name, getattr(subject, name), member, subject))


def _call_faults(name: str, subject: object, member: Callable[..., Any], owner: object = None) -> Iterator[str]:
    """What is wrong with the way in which something is called; `member` is that of the protocol."""
    count = len(inspect.signature(member).parameters) - 1
    if not callable(subject):
        yield f"{name} is {subject!r}, but should be {_called(name, member)}"
        return
    unbound = inspect.isclass(owner) and inspect.isfunction(inspect.getattr_static(owner, name))
    if not _takes(subject, count + unbound):
        given = _shown(inspect.signature(subject))
        yield f"{name} is called as {name}{given}, but should be {_called(name, member)}"


def _takes(subject: Callable[..., Any], count: int) -> bool:
    """Whether something can be called with so many arguments, as far as it says how it is called."""
    try:
        inspect.signature(subject).bind(*range(count))
    except TypeError:
        return False
    except ValueError:  # written in C, without a signature
        return True
    return True


def _called(name: str, member: Callable[..., Any]) -> str:
    return name + _shown(inspect.signature(member))


def _shown(signature: inspect.Signature) -> str:
    """A signature as its caller sees it."""
    shown = [parameter for parameter in signature.parameters.values() if parameter.name != "self"]
    return str(signature.replace(parameters=shown)).replace("'", "").replace(", /", "")
