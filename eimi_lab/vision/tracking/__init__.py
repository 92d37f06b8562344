"""Follow the beam from frame to frame of a recording, faster than a fast camera takes the frames.

beam_curve      the centre line of a beam of fixed length, in a few numbers
beam_tracker    find the beam in each frame near its place in the previous frames
step_places     places of the edges on profiles, also of edges that the motion blurs
steady_view     remove the motion of the camera
"""
