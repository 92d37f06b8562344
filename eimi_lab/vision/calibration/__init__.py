"""Measure the calibration of a camera: the scale, the lens, the clamp, the axis of the beam, and gravity.

calibration_file   make a calibration from images
writing            write a calibration as a calibration.toml
board              find a calibration board in an image, and print a board at its true size
lens               calibrate the lens on views of a board, and measure the pose of a board in the beam's plane
known_width        measure scale and axis on an image of the beam at rest, whose width is known
clicked_bench      compute a calibration from clamp, tip and ruler that a person clicked on a photograph
exif_lens          read the focal length that a phone writes in its pictures
plumb_line         measure the direction of gravity on a picture of a thread with a weight
"""
