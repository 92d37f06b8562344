"""How large a millimetre is in the picture, where the clamp is, and which way the beam and gravity point.

`calibration_file` makes a calibration.toml. Scale and axis come from a board (`board`) in the beam's plane through a
lens without or with distortion (`lens`), or from the beam at rest, whose width is known (`known_width`); gravity comes
from a thread with a weight (`plumb_line`).
"""
