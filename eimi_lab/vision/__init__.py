"""Measure both edges of the beam in camera frames, in millimetres.

edges                find the edges in one image
following            follow the beam from its clamp in a photograph without a back-light
tracking             follow the beam from frame to frame of a recording
calibration          measure the scale, the clamp, the axis and the direction of gravity
image_files          list the images of a folder, and read an image file
heic                 read the HEIC pictures of an iPhone
image_sizes          read the size of an image from its header, before the pixels are decoded
image_wholeness      check that an image file is complete
intensity            combine colours and frames into one image, and correct it by a dark frame and a flat field
projection           choose the colour projection in which the beam differs most from its surroundings
beam_frame           map pixels to millimetres in the beam frame, and back
field_at_beam        apply the coil's field and the background field of a calibration to loads
check                one quality check of a state (load step), and the flag that records its failure
flags                the table of all quality checks
followed_checks      the quality checks of edges that were followed from the clamp
frame_checks         check the frames of one state for losses, repetitions and motion
settling_statistic   compare two frames with the noise of the camera
clicked_points       check the points that a person clicked on the centre line
ruled_picture        draw a grid of pixel coordinates over a frame

docs/why/edges.md contains the measured errors of the edges. `benchmarks/edges.py` prints these errors, and
`benchmarks/flag_pictures.py` renders a picture for every flag.
"""
