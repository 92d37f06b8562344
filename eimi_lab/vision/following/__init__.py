"""Follow the beam from its clamp, in a photograph without a back-light.

follow         the entry point: from one image to both edges and their quality
centre_line    an expected centre line: clicked, or of an earlier picture
stated         the stated clamp, axis, width and length of the beam, in pixels
in_picture     the stated beam of a calibration and specimen, and the image scaled to 255
working        cut the image to the reach of the beam, and scale the beam to a given width
reflections    remove narrow clipped reflections
hypotheses     hypotheses of a strip, and how well the image supports each
beam_search    search for the strip from the clamp outward
unrolled       sample the image along the strip, so that its edges are nearly straight
discriminant   project colours by Fisher's discriminant of the two sides of an edge
seams          find an edge as the seam of largest fall, by dynamic programming
colour_seams   the seams of both edges, each in its own colour projection
shadows        move an edge from the border of a shadow to the edge of the beam
support        where each edge is sure, and where the beam ends
edge_points    fit blurred steps in the original image, and estimate the scatter of the points
ends           remove the points at both ends where the width of the beam changes
clicks         compare the followed path with clicked points
doubts         measure shadows, reflections and clipping at the edges
explaining     draw pictures of the intermediate results

The clamp, the axis, the width and the length are known to a few per cent. Neither an even background nor the sign of
the contrast needs to be known. docs/why/edges.md describes the steps and their errors.
"""
