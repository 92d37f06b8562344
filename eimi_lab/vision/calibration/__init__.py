"""Measure the scale, the lens, the clamp, the beam's axis and gravity in the images of a camera.

calibration_file   make a calibration from images
writing            write a calibration file
board              find a calibration board in an image, and print a board
lens               calibrate the lens, and measure the pose of a board
known_width        measure scale and axis on an image of the beam at rest
clicked_bench      compute a calibration from points that a person clicked on a photograph
exif_lens          read the focal length from the Exif data of a picture
plumb_line         measure the direction of gravity on a picture of a thread with a weight
"""
