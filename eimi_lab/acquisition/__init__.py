"""A run: a protocol taken through the bench, every state stored before the next one begins.

bench           opens the instruments that a rig names
cameras         the camera that a rig names: a device, a recording, a virtual beam
playback        a recording that plays the camera, and whether it is long enough
coil            the supply as a coil sees it: ramps, and a current that is what was asked for
events          what happens in a run: a dataclass for each thing
event_words     events in English, for a person
event_lines     events as lines of JSON, for a program
switching_off   every way out of a run ends with the coil off
interruption    what a run does about signals while an operation is under way
guardian        a process that switches off when a run dies or stands still: the run's side of it
guardian_process    the process itself
settling        whether the beam is at rest, from consecutive frames
capture         the frames of a state and what is wrong with them
transients      frames kept while the beam settles, and after the current went to zero
conditioning    cycles before the run, and what they changed
stepping        one state after another
pausing         a run that waits for a person
live_view       a look at the frames while a run goes on
heating         whether the coil bears a protocol
resuming        going on with a run that ended early
run             the run itself
dry_run         what a run would do, down to the bytes on the wire
"""
