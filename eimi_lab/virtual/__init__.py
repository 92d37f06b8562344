"""A simulated bench: supply, coil, beam, camera and sensors behind the interfaces of the drivers.

virtual_rig      the supply and the camera of the simulated bench
served_bench     serve the simulated bench to other programs, by the protocols of real instruments
client_rig       the rig file for a program that measures on the served bench
virtual_sensors  the gaussmeter and the thermometers of the simulated bench
moving_beam      the motion of the virtual specimen, with the true viscoelastic law that a fit does not know
rod              the elastic rod with a rigid magnet that models the moving specimen
moving_outlines  the outlines of the virtual specimen in motion
beam             the finite-element shape of the virtual specimen in the field of the coil
optics           the image of the beam in front of a back-light
raster           the fraction of each pixel that a polygon covers
simulation       the shapes of a specimen with known parameters, and the files of `eimi simulate`
"""
