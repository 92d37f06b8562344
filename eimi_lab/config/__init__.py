"""Read and validate the TOML files that a user edits.

Each kind of file has a module with a pydantic model of the file and a function ``load_…``, which takes a path or the
name of a shipped file. If a file is wrong, the function raises an `InputError` that tells the file, the key, the value
and what would be right. Each model keeps the text of its file, so that a dataset can store the text with its comments.

specimen          specimen.toml: the beam, its magnet and the point where a tip force acts
size_along        a width or depth of the beam that may vary along its length
protocol          protocol.toml: the currents of a run, and when the frames of each state are taken
rig               rig.toml: the supply, the camera and the coil of a bench
sensor            the table [[sensors]] of a rig: gaussmeters, thermometers and other sensors
interlock         the table [[interlocks]] of a rig: bounds of a reading beyond which the coil is switched off
calibration       calibration.toml: scale, orientation and lens of the camera, and the coil constant
coil_shape        the table [field] of a calibration: the field of the coil as a function of position
people            people.toml: the authors of a published archive
materials         materials.toml: the true materials of the specimens of a virtual rig
simulated_optics  the table [virtual.optics] of a rig: back-light, lens and sensor of the virtual camera
uncertainty       the table [uncertainty] in the files of specimens, calibrations and rigs
rig_uncertainty   the uncertainty of the current, read from the rig file in a dataset
csv_tables        CSV tables that a user writes
json_text         parsing of JSON text; NaN, very long numbers and very deep nesting are errors
toml              validation of TOML text against a pydantic model
"""
