"""Describe the emulated GigE Vision camera in GenICam XML, for the fake camera of Aravis.

Sources: Aravis 0.8 (arvfakecamera.h, arvgvcpprivate.h) for the addresses of the registers, and the GenICam Standard
Features Naming Convention (SFNC 2.7) for the names of the features.
"""

from __future__ import annotations

from eimi_drivers.cameras.pixel_formats import PIXEL_FORMATS

SENSOR_HEIGHT, SENSOR_WIDTH = 0x118, 0x11C
WIDTH, HEIGHT, OFFSET_X, OFFSET_Y = 0x100, 0x104, 0x130, 0x134
PIXEL_FORMAT, ACQUISITION, ACQUISITION_MODE, FRAME_PERIOD_US, EXPOSURE_US = 0x128, 0x124, 0x12C, 0x138, 0x120
TRIGGER_MODE, TRIGGER_SOURCE, TRIGGER_ACTIVATION, TRIGGER_SOFTWARE = 0x300, 0x304, 0x308, 0x30C
GAIN, GAIN_AUTO = 0x110, 0x114

ROW_READOUT_US = 10
"""Readout time of one row of the emulated rolling shutter, µs."""

_FORMATS = (
    "Mono8",
    "Mono12",
    "Mono12Packed",
    "Mono12p",
    "Mono16",
    "BayerRG8",
    "BayerGR8",
    "BayerGB8",
    "BayerBG8",
    "BayerRG12Packed",
)
_TEXTS = {
    "DeviceVendorName": (0x48, 32),
    "DeviceModelName": (0x68, 32),
    "DeviceVersion": (0x88, 32),
    "DeviceSerialNumber": (0xD8, 16),
    "DeviceID": (0xD8, 16),
}


def describe(rows_step: int = 1, shutter: str = "Global") -> str:
    """Return the GenICam description of the emulated camera as XML text.

    Parameters
    ----------
    rows_step : int
        The height of the region is rounded down to a multiple of this number.
    shutter : str
        The kind of shutter: "Global" or "Rolling".
    """
    formats = {pixel_format.name: code for code, pixel_format in PIXEL_FORMATS.items()}
    nodes = [
        *(_text(name, *place) for name, place in _TEXTS.items()),
        _integer("SensorWidth", SENSOR_WIDTH, access="RO"),
        _integer("SensorHeight", SENSOR_HEIGHT, access="RO"),
        _formula("MaxOffsetX", "A - B", A="SensorWidth", B="Width"),
        _formula("MaxOffsetY", "A - B", A="SensorHeight", B="Height"),
        _integer("OffsetX", OFFSET_X, "<Min>0</Min><pMax>MaxOffsetX</pMax>"),
        _integer("OffsetY", OFFSET_Y, "<Min>0</Min><pMax>MaxOffsetY</pMax>"),
        _integer("Width", WIDTH, "<Min>1</Min><pMax>SensorWidth</pMax>"),
        f"""<Integer Name="Height"><pValue>HeightRounded</pValue><Min>1</Min><pMax>SensorHeight</pMax></Integer>
        <IntConverter Name="HeightRounded"><FormulaTo>FROM - FROM % {rows_step}</FormulaTo>
        <FormulaFrom>TO</FormulaFrom><pValue>HeightRegister</pValue></IntConverter>{_register("Height", HEIGHT)}""",
        _choice("PixelFormat", PIXEL_FORMAT, {name: formats[name] for name in _FORMATS}),
        _choice("AcquisitionMode", ACQUISITION_MODE, {"Continuous": 1, "SingleFrame": 2}),
        _command("AcquisitionStart", 1, "AcquisitionRegister"),
        _command("AcquisitionStop", 0, "AcquisitionRegister"),
        _register("Acquisition", ACQUISITION),
        _converted("AcquisitionFrameRate", FRAME_PERIOD_US, "1000000.0 / FROM", "1000000.0 / TO", 1000, 10**7),
        _choice("TriggerSelector", None, {"FrameStart": 0}),
        _choice("TriggerMode", TRIGGER_MODE, {"Off": 0, "On": 1}),
        _choice("TriggerSource", TRIGGER_SOURCE, {"Line0": 0, "Software": 1}),
        _choice("TriggerActivation", TRIGGER_ACTIVATION, {"RisingEdge": 0}),
        _command("TriggerSoftware", 1, "TriggerSoftwareRegister"),
        _register("TriggerSoftware", TRIGGER_SOFTWARE),
        _converted("ExposureTime", EXPOSURE_US, "FROM", "TO", 10, 10**7),
        _converted("Gain", GAIN, "FROM * 100", "TO / 100.0", 0, 2400),
        _choice("GainAuto", GAIN_AUTO, {"Off": 1, "Continuous": 2}),
        _choice("SensorShutterMode", None, {shutter: 0}),
        f'<Float Name="SensorReadoutTime"><pValue>ReadoutFormula</pValue></Float>'
        f'<SwissKnife Name="ReadoutFormula"><pVariable Name="ROWS">Height</pVariable>'
        f"<Formula>ROWS * {ROW_READOUT_US}</Formula></SwissKnife>",
        _formula(
            "PayloadSize", "W * H * ((F &gt;&gt; 16) &amp; 0xFF) / 8", W="Width", H="Height", F="PixelFormatRegister"
        ),
        '<Integer Name="TLParamsLocked"><Value>0</Value><Min>0</Min><Max>1</Max></Integer>',
        '<Port Name="Device"/>',
    ]
    features = "".join(f"<pFeature>{name}</pFeature>" for name in (*_TEXTS, *_FEATURES))
    return f"""<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="Emulated" VendorName="eimi-lab" StandardNameSpace="None" SchemaMajorVersion="1"
 SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0"
 ToolTip="Emulated camera" ProductGuid="0" VersionGuid="0" xmlns="http://www.genicam.org/GenApi/Version_1_1">
<Category Name="Root" NameSpace="Standard">{features}</Category>
{"".join(nodes)}
</RegisterDescription>
"""


_FEATURES = (
    "SensorWidth",
    "SensorHeight",
    "OffsetX",
    "OffsetY",
    "Width",
    "Height",
    "PixelFormat",
    "AcquisitionMode",
    "AcquisitionStart",
    "AcquisitionStop",
    "AcquisitionFrameRate",
    "TriggerSelector",
    "TriggerMode",
    "TriggerSource",
    "TriggerActivation",
    "TriggerSoftware",
    "ExposureTime",
    "Gain",
    "GainAuto",
    "SensorShutterMode",
    "SensorReadoutTime",
    "PayloadSize",
)


def _register(name: str, address: int, access: str = "RW") -> str:
    return (
        f'<IntReg Name="{name}Register"><Address>{address:#x}</Address><Length>4</Length><AccessMode>{access}'
        "</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
    )


def _integer(name: str, address: int, bounds: str = "", access: str = "RW") -> str:
    return f'<Integer Name="{name}"><pValue>{name}Register</pValue>{bounds}</Integer>{_register(name, address, access)}'


def _formula(name: str, formula: str, **variables: str) -> str:
    stated = "".join(f'<pVariable Name="{letter}">{node}</pVariable>' for letter, node in variables.items())
    return f'<IntSwissKnife Name="{name}">{stated}<Formula>{formula}</Formula></IntSwissKnife>'


def _converted(name: str, address: int, to_register: str, from_register: str, smallest: int, largest: int) -> str:
    # Return the XML of a numerical feature whose value is computed from the integer in a register of the camera.
    # `to_register` is the formula for the integer, with FROM for the value; `from_register` is that for the value, with
    # TO for the integer (names of the GenICam standard). `smallest` and `largest` are the bounds of the integer.
    return (
        f'<Float Name="{name}"><pValue>{name}Converter</pValue></Float>'
        f'<Converter Name="{name}Converter"><FormulaTo>{to_register}</FormulaTo><FormulaFrom>{from_register}'
        f"</FormulaFrom><pValue>{name}Bounded</pValue></Converter>"
        f'<Integer Name="{name}Bounded"><pValue>{name}Register</pValue><Min>{smallest}</Min><Max>{largest}</Max>'
        f"</Integer>{_register(name, address)}"
    )


def _choice(name: str, address: int | None, values: dict[str, int]) -> str:
    entries = "".join(
        f'<EnumEntry Name="{entry}"><Value>{value}</Value></EnumEntry>' for entry, value in values.items()
    )
    if address is None:
        return f'<Enumeration Name="{name}">{entries}<Value>{next(iter(values.values()))}</Value></Enumeration>'
    return (
        f'<Enumeration Name="{name}">{entries}<pValue>{name}Register</pValue></Enumeration>{_register(name, address)}'
    )


def _command(name: str, value: int, register: str) -> str:
    return f'<Command Name="{name}"><pValue>{register}</pValue><CommandValue>{value}</CommandValue></Command>'


def _text(name: str, address: int, length: int) -> str:
    return (
        f'<StringReg Name="{name}"><Address>{address:#x}</Address><Length>{length}</Length><AccessMode>RO</AccessMode>'
        "<pPort>Device</pPort></StringReg>"
    )
