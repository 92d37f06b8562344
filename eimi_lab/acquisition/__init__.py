"""A run: a protocol taken through the bench, every state stored before the next one begins.

bench           opens the instruments that a rig names
coil            the supply as a coil sees it: ramps, and a current that is what was asked for
switching_off   every way out of a run ends with the coil off
guardian        switches off when a run dies without a chance to do so itself
settling        whether the beam is at rest, from consecutive frames
capture         the frames of a state and what is wrong with them
live_view       a look at the frames while a run goes on
heating         whether the coil bears a protocol
resuming        going on with a run that ended early
run             the run itself
dry_run         what a run would do, down to the bytes on the wire
"""
