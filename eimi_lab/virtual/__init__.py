"""A bench without instruments: coil, beam and camera behind the drivers' own interfaces.

virtual_rig puts them together: an emulated supply, the beam's finite-element shape in the coil's field (`beam`), and
what a camera sees of it (`optics`, `raster`). Its numbers stand in the rig's table [virtual].
"""
