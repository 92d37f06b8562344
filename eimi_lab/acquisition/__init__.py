"""Acquire a dataset: run a protocol on a bench, and store every state (load step) before the next state begins.

run               the run itself
stepping          one state after another
coil              change the current in ramps, and compare the measured current with the set-point
settling          decide from consecutive frames whether the beam is at rest
capture           take the frames of one state, and name their defects (flags)
transients        choose the frames that are kept while the beam settles or creeps
ring_downs        set the current to zero in one step, and record every frame of the swinging beam
conditioning      load cycles before the run, and the change of the beam's shape that the cycles cause
pausing           switch the coil off between two states until a person continues the run
polarity          swap the leads of a coil whose supply cannot reverse its current
resuming          continue a run that ended early
supply_trial      try a driver on a real supply without a coil
trial_form        the form that reports the trial of a supply
supply_lock       one run at a time for each supply
open_coil         open the supply and the sensors that a rig names
coil_calibration  measure the field of the coil against its current
output_off        begin with the output of the supply off
open_bench        open the instruments that a rig names
added_driver      send to the guardian process a driver that the user's program added
cameras           the camera that a rig names: a device, a recording or a virtual beam
playback          a recording in place of a camera
live_view         show the frames during a run
sensing           read the sensors of the bench
interlocks        end the run if a reading leaves its bounds
heating           decide whether the coil withstands a protocol
switching_off     end every run with the coil off
doubt             report that the coil may still be on, if switching it off takes long
interruption      react to signals during an operation
guardian          start the guardian process of a run, and exchange messages with it
guardian_process  the guardian process: it switches the coil off if the run dies or stands still
events            one dataclass for each thing that happens in a run
event_words       events in English, for a person
event_lines       events as lines of JSON, for a program
dry_run           print the steps of a run, with the exact messages to the supply
"""
