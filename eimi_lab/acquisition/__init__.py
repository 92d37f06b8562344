"""Acquire a dataset: run a protocol on a bench, and store every state (load step) before the next state begins.

run               run a protocol
stepping          take one state after another
coil              change the current in ramps, and compare the measured current with the set-point
settling          wait until the beam is at rest
capture           take the frames of one state, and flag frames with defects
transients        choose the frames that are kept while the beam settles or creeps
ring_downs        set the current to zero in one step, and record the swinging beam
conditioning      apply load cycles before the run, and measure how they change the beam's shape
pausing           switch the coil off between two states until a person continues the run
polarity          swap the leads of a coil whose supply cannot reverse its current
resuming          continue a run that ended early
supply_trial      try a driver on a real supply without a coil
trial_form        write the form that reports the trial of a supply
supply_lock       allow only one run at a time for each supply
open_coil         open the supply and the sensors of a rig file
coil_calibration  measure the field of the coil against its current
output_off        begin with the output of the supply off
open_bench        open the instruments of a rig file
added_driver      send a driver of the user's program to the guardian process
cameras           open the camera of a rig file: a device, a recording or a virtual beam
playback          play a recording in place of a camera
live_view         show the frames during a run
sensing           read the sensors
interlocks        end the run if a reading leaves its bounds
current_steps     refuse currents between the steps of the supply
heating           predict whether a protocol overheats the coil
switching_off     end every run with the coil off
doubt             report that the coil may still be on, if switching it off takes long
interruption      react to signals during an operation
guardian          start the guardian process of a run, and exchange messages with it
guardian_process  switch the coil off if the run dies or stands still
events            define one dataclass for each kind of event in a run
event_words       describe events in English
event_lines       write and read events as lines of JSON
dry_run           list the steps of a run and the messages to the supply
"""
