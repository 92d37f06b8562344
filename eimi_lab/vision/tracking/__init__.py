"""Follow the beam from frame to frame of a recording.

beam_curve      the centre line of a beam of fixed length, as a curve with few parameters
beam_tracker    find the beam in each frame near its place in the previous frames
step_places     measure the positions of edges that may be blurred by motion
steady_view     remove the motion of the camera
"""
