"""Read and validate the TOML files that a user edits.

specimen          specimen.toml: the beam, its magnet and the point where a tip force acts
size_along        a width or depth of the beam that may vary along its length
protocol          protocol.toml: the currents of a run, and when frames are taken
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
json_text         parsing of JSON text
toml              validation of TOML text against a pydantic model
"""
