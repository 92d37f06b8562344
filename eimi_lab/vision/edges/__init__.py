"""Locate both edges of the beam in one image, to a few hundredths of a pixel.

finding                 find the edges by the silhouette, or else by following the beam from its clamp
back_lit                locate the edges of a beam in front of a back-light
clamp_line              find the line at which the beam leaves its clamp
silhouette              find the outline of the beam to about a pixel, and the corners of its tip
passes                  refine the outline to edge points, in two passes
profiles                read grey values along normals, and fit blurred steps to them
uneven_light            estimate how the back-light changes along a profile
curve                   fit a smooth curve through the points of an edge of the beam
edge_set                the result: both edges, the corners of the beam and the flags (failed quality checks)
stated_shape            lengths and widths of the specimen, whose width may vary along its length
dimensions              measure width, length and twist of the beam from its edges
quality                 measure contrast, clipping, blur and gamma at the edges
response                estimate the gamma of the camera from grey values across the edges
apparent_width          measure the width of the beam near its clamp, from grey values alone
region                  the part of the pictures in which the beam is searched
suggested_corrections   suggest which value of the calibration is wrong if no beam was found
overlay                 draw the edges and the flags on the frame

A beam without a silhouette is followed from its clamp by `eimi_lab.vision.following`.
"""
