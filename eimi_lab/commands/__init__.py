"""The commands of `eimi`: their options and their output. Other packages do the work.

beginning         init
bench             instruments, emulate, acquire, recover
trying            the questions of `eimi instruments --try`
images            import, segment
calibrating       calibrate
material_laws     fit, validate, tensile, simulate, export
next_run          plan
showing           report, demo
publishing        publish
studying          discover, study
watching          dashboard
shared_options    options of several commands, and options that are fields of a dataclass
picture_options   options for finding the beam in images
motion_options    options of `eimi import` for a motion
track_options     options for tracked points
examples          the examples that --help shows
result            the result of a command, and the options --json and --quiet

A command is one function. It imports what it needs when it runs, so that `eimi --help` is quick.
"""
