"""The file that describes the emulated GigE camera is consistent, and agrees with the standard and with Aravis."""

from __future__ import annotations

from xml.etree import ElementTree

from eimi_drivers.cameras.pixel_formats import PIXEL_FORMATS
from eimi_drivers.emulators.gige_features import ROW_READOUT_US, describe

NAME = "{http://www.genicam.org/GenApi/Version_1_1}"


def nodes(rows_step: int = 1, shutter: str = "Global") -> dict[str, ElementTree.Element]:
    root = ElementTree.fromstring(describe(rows_step, shutter))
    return {element.attrib["Name"]: element for element in root if "Name" in element.attrib}


def test_every_node_that_the_description_of_the_camera_names_exists() -> None:
    described = nodes()
    for name, element in described.items():
        for reference in ("pFeature", "pValue", "pMax", "pPort", "pVariable"):
            for named in element.iter(f"{NAME}{reference}"):
                assert named.text in described, (name, named.text)
    assert len(described) == len(list(ElementTree.fromstring(describe())))


# The registers of the fake camera of Aravis 0.8 (arvfakecamera.h), which the features of the description use.
REGISTERS = {
    **{
        "Width": 0x100,
        "Height": 0x104,
        "OffsetX": 0x130,
        "OffsetY": 0x134,
        "SensorWidth": 0x11C,
        "SensorHeight": 0x118,
    },
    **{"PixelFormat": 0x128, "AcquisitionMode": 0x12C, "Acquisition": 0x124, "AcquisitionFrameRate": 0x138},
    **{"ExposureTime": 0x120, "Gain": 0x110, "GainAuto": 0x114, "TriggerMode": 0x300, "TriggerSource": 0x304},
    **{"TriggerActivation": 0x308, "TriggerSoftware": 0x30C},
}
# arvgvcpprivate.h: bootstrap registers of GigE Vision
TEXTS = {"DeviceVendorName": (0x48, 32), "DeviceModelName": (0x68, 32), "DeviceVersion": (0x88, 32)}
TEXTS |= {"DeviceSerialNumber": (0xD8, 16), "DeviceID": (0xD8, 16)}


def inner(element: ElementTree.Element, name: str) -> str:
    return str(element.findtext(f"{NAME}{name}"))


def test_features_of_the_emulated_camera_use_the_registers_of_aravis() -> None:
    described = nodes()
    registers = {name.removesuffix("Register"): node for name, node in described.items() if node.tag == f"{NAME}IntReg"}
    assert {name: int(inner(node, "Address"), 0) for name, node in registers.items()} == REGISTERS
    assert {inner(node, "Length") for node in registers.values()} == {"4"}
    read_only = {name for name, node in registers.items() if inner(node, "AccessMode") == "RO"}
    assert read_only == {"SensorWidth", "SensorHeight"}
    assert {
        name: (int(inner(described[name], "Address"), 0), int(inner(described[name], "Length"))) for name in TEXTS
    } == TEXTS


def test_choices_and_commands_of_the_emulated_camera_have_the_values_of_the_standard() -> None:
    described = nodes(shutter="Rolling")
    choices = {
        name: {entry.attrib["Name"]: int(inner(entry, "Value")) for entry in node.iter(f"{NAME}EnumEntry")}
        for name, node in described.items()
        if node.tag == f"{NAME}Enumeration"
    }
    formats = {pixel_format.name: code for code, pixel_format in PIXEL_FORMATS.items()}
    assert choices.pop("PixelFormat").items() <= formats.items()
    assert choices == {
        "AcquisitionMode": {"Continuous": 1, "SingleFrame": 2},
        "TriggerSelector": {"FrameStart": 0},
        "TriggerMode": {"Off": 0, "On": 1},
        "TriggerSource": {"Line0": 0, "Software": 1},
        "TriggerActivation": {"RisingEdge": 0},
        "GainAuto": {"Off": 1, "Continuous": 2},
        "SensorShutterMode": {"Rolling": 0},
    }
    commands = {
        name: (inner(node, "pValue"), inner(node, "CommandValue"))
        for name, node in described.items()
        if node.tag == f"{NAME}Command"
    }
    assert commands == {
        "AcquisitionStart": ("AcquisitionRegister", "1"),
        "AcquisitionStop": ("AcquisitionRegister", "0"),
        "TriggerSoftware": ("TriggerSoftwareRegister", "1"),
    }
    bounds = {
        name.removesuffix("Bounded"): (int(inner(node, "Min")), int(inner(node, "Max")))
        for name, node in described.items()
        if name.endswith("Bounded")
    }
    assert bounds == {"AcquisitionFrameRate": (1000, 10**7), "ExposureTime": (10, 10**7), "Gain": (0, 2400)}
    assert inner(described["ReadoutFormula"], "Formula") == f"ROWS * {ROW_READOUT_US}" == "ROWS * 10"
    assert inner(nodes(rows_step=4)["HeightRounded"], "FormulaTo") == "FROM - FROM % 4"
