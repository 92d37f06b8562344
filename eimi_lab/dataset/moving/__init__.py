"""Motions of the beam in a dataset: free oscillations (ring-downs) and creep, as positions of points over time.

stored_motions    store motions in a dataset, and read them
motion_facts      facts about a recording that the user gives, such as the frame rate
free_motion       the part of a recording after the release of the beam
beam_modes        vibration modes of a cantilever, and their amplitudes in a motion
motion_csv        motions from a table of tracked points
tracked_motion    motions from the files of tracking programs
video_times       times at which the frames of a video were recorded
clicked_line      a calibration from points that the user clicked on the beam
film              points of the beam in every frame of a video or of a recording
flicks            division of a recording in which the beam was pushed several times
filmed_motion     motions from videos
recorded_motion   motions from the recorded frames of a run
recording_checks  checks for lost frames and for a slow camera
motion_import     write an imported motion into a dataset
"""
