"""Motions of the beam in a dataset: free oscillations (ring-downs) and creep, as positions of points over time.

stored_motions    store motions in the file of a dataset, and read them
motion_facts      facts about a recording that the user gives: kind, rate, release, weights, shutter
free_motion       the part of a recording after the release of the beam
beam_modes        modes of a cantilever, and the amplitudes of these modes in a motion
motion_csv        motions from a table of tracked points
tracked_motion    motions from the files of tracking programs
video_times       times at which the frames of a video were recorded
clicked_line      a calibration that is computed from points which the user clicked on the beam
film              points of the beam in every frame of a video or of a recording
flicks            division of a recording in which the beam was flicked (pushed briefly) several times
filmed_motion     motions from videos
recorded_motion   motions from the recorded frames of a run
recording_checks  flags for lost frames and for a camera that was too slow
motion_import     write an imported motion into a dataset
"""
