"""Check that drivers and instruments have the methods and attributes that `eimi_drivers.interfaces` requires."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any

from eimi_drivers.interfaces import (
    Camera,
    CameraDriver,
    PowerSupply,
    Sensor,
    SensorDriver,
    SupplyDriver,
    UnusableDriver,
)


def check_supply_driver(name: str, driver: object) -> None:
    """Raise UnusableDriver if a driver of a supply has wrong arguments or lacks a required method.

    Parameters
    ----------
    name : str
        Name of the driver, for the message.
    driver : object
        Class or function that opens a supply.
    """
    faults = [*_call_faults(_name(driver), driver, SupplyDriver.__call__), *_connect_faults(driver)]
    _raise("supply", name, driver, [*faults, *_class_faults(driver, PowerSupply)])


def check_camera_driver(name: str, driver: object) -> None:
    """Raise UnusableDriver if a driver of a camera has wrong arguments or lacks a required method.

    Parameters
    ----------
    name : str
        Name of the driver, for the message.
    driver : object
        Class or function that opens a camera.
    """
    _raise(
        "camera",
        name,
        driver,
        [*_call_faults(_name(driver), driver, CameraDriver.__call__), *_class_faults(driver, Camera)],
    )


def check_sensor_driver(name: str, driver: object) -> None:
    """Raise UnusableDriver if a driver of a sensor has wrong arguments or lacks a required method.

    Parameters
    ----------
    name : str
        Name of the driver, for the message.
    driver : object
        Class or function that opens a sensor.
    """
    faults = [*_call_faults(_name(driver), driver, SensorDriver.__call__), *_connect_faults(driver)]
    _raise("sensor", name, driver, [*faults, *_class_faults(driver, Sensor)])


def check_supply(name: str, driver: object, supply: PowerSupply) -> None:
    """Raise UnusableDriver if an open supply lacks a member of `PowerSupply`; the supply is then closed.

    `name` and `driver` describe the driver in the message.
    """
    _check_opened("supply", name, driver, supply, PowerSupply)


def check_camera(name: str, driver: object, camera: Camera) -> None:
    """Raise UnusableDriver if an open camera lacks a member of `Camera`; the camera is then closed.

    `name` and `driver` describe the driver in the message.
    """
    _check_opened("camera", name, driver, camera, Camera)


def check_sensor(name: str, driver: object, sensor: Sensor) -> None:
    """Raise UnusableDriver if an open sensor lacks a member of `Sensor`; the sensor is then closed.

    `name` and `driver` describe the driver in the message.
    """
    _check_opened("sensor", name, driver, sensor, Sensor)


def _connect_faults(driver: object) -> Iterator[str]:
    if (connect := getattr(driver, "connect", None)) is not None and not _takes(connect, 1):
        yield "connect cannot be called as connect(address)"


def _check_opened(
    kind: str, name: str, driver: object, instrument: PowerSupply | Camera | Sensor, protocol: type
) -> None:
    faults = dict(_faults(instrument, protocol))
    try:
        if faults and "close" not in faults:
            instrument.close()
    finally:  # an error of close() is less important than the missing members
        _raise(kind, name, driver, list(faults.values()))


def _raise(kind: str, name: str, driver: object, faults: list[str]) -> None:
    if faults:
        where = f"{getattr(driver, '__module__', '?')}.{_name(driver)}"
        raise UnusableDriver(f"the {kind} driver {name!r} ({where}) cannot be used: {'; '.join(faults)}")


def _name(driver: object) -> str:
    return str(getattr(driver, "__name__", type(driver).__name__))


def _class_faults(driver: object, protocol: type) -> Iterator[str]:
    """Yield a text for each missing or wrong method of a driver that is a class; nothing for a function."""
    if not inspect.isclass(driver):
        return
    for name in sorted(getattr(driver, "__abstractmethods__", ())):
        yield f"{name} is missing"
    for name, fault in _faults(driver, protocol):
        if name not in protocol.__annotations__:  # an attribute may exist only in an instance, not in the class
            yield fault


def _faults(subject: object, protocol: type) -> Iterator[tuple[str, str]]:
    """Yield name and description of each interface member that `subject` lacks or that has wrong arguments."""
    for name, kind in protocol.__annotations__.items():
        if not hasattr(subject, name):
            yield name, f"{name} is missing (needed: an attribute of type {kind})"
    for name, member in vars(protocol).items():
        if name.startswith("_") or not inspect.isfunction(member):
            continue
        does = str(member.__doc__).splitlines()[0]
        if not hasattr(subject, name):
            yield name, f"{name} is missing (needed: {_called(name, member)}: {does})"
        else:
            yield from ((name, fault) for fault in _call_faults(name, getattr(subject, name), member, subject))


def _call_faults(name: str, subject: object, member: Callable[..., Any], owner: object = None) -> Iterator[str]:
    """Yield a text if the method `subject` of `owner` does not take the arguments of the interface method `member`."""
    count = len(inspect.signature(member).parameters) - 1
    if not callable(subject):
        yield f"{name} is {subject!r}, but should be {_called(name, member)}"
        return
    unbound = inspect.isclass(owner) and inspect.isfunction(inspect.getattr_static(owner, name))
    if not _takes(subject, count + unbound):
        signature = _shown(inspect.signature(subject))
        yield f"{name} is called as {name}{signature}, but should be {_called(name, member)}"


def _takes(subject: Callable[..., Any], count: int) -> bool:
    """Return whether a callable accepts `count` positional arguments; True if it has no signature."""
    try:
        inspect.signature(subject).bind(*range(count))
    except TypeError:
        return False
    except ValueError:  # the callable is written in C and has no signature
        return True
    return True


def _called(name: str, member: Callable[..., Any]) -> str:
    return name + _shown(inspect.signature(member))


def _shown(signature: inspect.Signature) -> str:
    """Return a signature as text without ``self``, quotation marks and ``/``."""
    parameters = [parameter for parameter in signature.parameters.values() if parameter.name != "self"]
    return str(signature.replace(parameters=parameters)).replace("'", "").replace(", /", "")
