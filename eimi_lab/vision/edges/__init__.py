"""Locate both edges of the beam in one image, to a few hundredths of a pixel.

finding                 find the edges by the silhouette, or else by following the beam from its clamp
back_lit                locate the edges of a beam in front of a back-light
clamp_line              find the line at which the beam leaves its clamp
silhouette              find the outline of the beam and the corners of its tip
passes                  refine the outline to edge points, in two searches
profiles                read grey values across an edge, and fit blurred steps to them
uneven_light            estimate how the back-light changes across an edge
curve                   fit a smooth curve through the points of an edge
edge_set                both edges, the corners of the beam and the flags (failed quality checks)
stated_shape            lengths and widths of the specimen
dimensions              measure width, length and twist of the beam
quality                 measure contrast, clipping, blur and gamma at the edges
response                estimate the gamma of the camera
apparent_width          measure the width of the beam near its clamp
region                  the part of the pictures in which the program searches for the beam
suggested_corrections   suggest which value is wrong if no beam was found
overlay                 draw the edges and the flags on the frame
"""
