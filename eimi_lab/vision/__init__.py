"""Measure both edges of the beam in camera frames, in millimetres.

edges                find the edges in one image
following            follow the beam from its clamp in a photograph without a back-light
tracking             follow the beam from frame to frame of a recording
calibration          measure the scale, the clamp, the axis and the direction of gravity
image_files          list and read image files
heic                 read the HEIC pictures of an iPhone
image_sizes          read the size of an image from the header of its file
image_wholeness      check that an image file is complete
intensity            combine colours and frames into one image, and correct its brightness
projection           convert colours to grey values with the largest contrast of the beam
beam_frame           map pixels to millimetres in the beam frame, and back
field_at_beam        the field that a calibration describes, at the beam
check                one quality check, and the flag that records its failure
flags                the table of all quality checks
followed_checks      the quality checks of edges that were followed from the clamp
frame_checks         check the frames of one load step for losses, repetitions and motion
settling_statistic   compare two frames with the noise of the camera
clicked_points       check the points that a person clicked on the centre line
ruled_picture        draw a grid of pixel coordinates over a frame
"""
