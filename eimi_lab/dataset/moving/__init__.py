"""Motions of the beam in a dataset: ring-downs and creep, as points with the time of each.

stored_motions    motions in the file
motion_facts      facts about a recording that a person states: kind, rate, release, weights, shutter
free_motion       the part of a recording after the release
beam_modes        the modes of a cantilever, and the amplitudes of a motion in them
motion_csv        motions from a table of tracked points
tracked_motion    motions from the files of tracking programs
video_times       times at which the frames of a video were recorded
clicked_line      a calibration from points that a person clicked on the beam
film              points of the beam in every frame of a film
flicks            the parts of a recording, one for each time the beam was moved
filmed_motion     motions from films
recorded_motion   motions from the recorded frames of a run
recording_checks  frames that were lost, and a camera that was too slow
motion_import     write an imported motion into a dataset
"""
