"""Measure the calibration of a camera: the scale, the lens, the clamp, the axis of the beam, and gravity.

calibration_file   make a calibration.toml from images
board              find a calibration board in an image, and print one to scale
lens               the lens from views of a board, and the pose of a board in the beam's plane
known_width        the scale and the axis from the beam at rest, whose width is known
clicked_bench      a calibration from clamp, tip and ruler that a person clicked on a photograph
exif_lens          the focal length that a phone states in its pictures
plumb_line         the direction of gravity from a picture of a thread with a weight
"""
