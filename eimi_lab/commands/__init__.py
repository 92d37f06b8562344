"""The commands of the program `eimi`: their options and their output. Other packages do the work.

beginning         init
bench             instruments, emulate, acquire, recover
trying            the trial of a supply by `eimi instruments --try`
images            import, segment
calibrating       calibrate
material_laws     fit, validate, tensile, simulate, export
next_run          plan
showing           report, demo
publishing        publish
studying          discover, study
watching          dashboard
shared_options    options of several commands, and the conversion of a dataclass into options of a command
picture_options   options that help the program to find the beam in images
motion_options    options of `eimi import` for ring-downs and creep
track_options     options of `eimi import` for tracked points
examples          the examples that --help shows
result            the result of a command, and the options --json and --quiet

Each command is one function. The function imports other modules only when it runs, so that `eimi --help` is quick.
"""
