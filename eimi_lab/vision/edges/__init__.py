"""Locate both edges of the beam in one image, to a few hundredths of a pixel.

finding                 find the edges by the silhouette, or else by following the beam from its clamp
back_lit                the search in front of a back-light
clamp_line              the line at which the beam leaves its clamp
silhouette              the outline of the beam to about a pixel, and the corners of its tip
passes                  the two passes that refine the outline to edge points
profiles                read grey values along normals, and fit blurred steps to them
uneven_light            how the back-light changes along a profile
curve                   a smooth curve through the points of an edge
edge_set                the result: both edges, the flags and the corners
stated_shape            lengths and widths of the specimen, which may vary along it
dimensions              width, length and twist of the beam as its edges show them
quality                 contrast, clipping, blur and gamma at the edges
response                the gamma of the camera, estimated from the shape of the edges
apparent_width          the width of the beam near its clamp, from grey values alone
region                  the part of the pictures in which the beam is searched
suggested_corrections   suggest which value of the calibration is wrong if no beam was found
overlay                 draw the edges and the flags on the frame

A beam without a silhouette is followed from its clamp by `eimi_lab.vision.following`.
"""
