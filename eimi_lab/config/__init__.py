"""The TOML files that a person edits, as validated values.

Each file has a module with a pydantic model and a function ``load_…`` that takes a path or the name of a shipped file.
Any fault in a file raises one `InputError` that names the file, the key, the value and what would be right. Each model
keeps the text from which it was read, so that a dataset can store the text with its comments.

specimen          specimen.toml: the beam, its magnet and the point where a tip force acts
size_along        a width or depth that may vary along the beam
protocol          protocol.toml: the currents of a run and the conditions at each of them
rig               rig.toml: the supply, the camera and the coil of a bench
sensor            the table [[sensors]] of a rig: gaussmeters, thermometers and other sensors
interlock         the table [[interlocks]] of a rig: bounds of a reading that keep the coil on
calibration       calibration.toml: scale, orientation and lens of the camera, and the coil constant
coil_shape        the table [field] of a calibration: the coil's field as a function of the place
people            people.toml: the authors of an archive
materials         materials.toml: the true materials of a virtual rig's specimens
simulated_optics  the table [virtual.optics] of a rig: back-light, lens and sensor of the virtual camera
uncertainty       the table [uncertainty] of specimens, calibrations and rigs
rig_uncertainty   the uncertainty of the current, read from the text of a rig that a dataset stores
csv_tables        CSV tables written by a person, with exact error messages
json_text         parsing of JSON text, which refuses NaN, very long numbers and very deep nesting
toml              validation of TOML text against a model, with one-line error messages
"""
