"""Follow the beam from its clamp, in a photograph without a back-light.

follow         the entry point: from one image to both edges and their quality
centre_line    an expected centre line: clicked by a person, or from an earlier picture
stated         clamp, axis, width and length of the beam in pixels, from calibration and specimen file
in_picture     compute place and size of the beam in pixels, and scale grey values to 0 to 255
working        cut the image to the reach of the beam, and scale the image to a given width of the beam
reflections    remove narrow reflections of a lamp, in which the picture is saturated
hypotheses     strips of the picture that may show the beam, and how well the image supports each strip
beam_search    search for the strip of the picture that shows the beam, from the clamp outward
unrolled       sample the image along the strip, so that the edges of the beam are nearly straight
crossings      leave out bodies that cross the beam
discriminant   project colours by Fisher's discriminant of the two sides of an edge
seams          find an edge by dynamic programming, as the line at which the projected colour falls most
colour_seams   find both edges, each in a colour projection of its own
shadows        move an edge from the border of a shadow to the edge of the beam
stated_width   move an edge inward if the body is wider than stated
support        decide where each edge is reliable, and where the beam ends
edge_points    fit blurred steps in the original image, and estimate the scatter of the points
ends           remove the points at both ends where the width of the beam changes
texture        average rough edges along the edge
clicks         compare the followed path with clicked points
doubts         measure shadows, reflections and clipping at the edges
explaining     draw pictures of the intermediate results

docs/why/edges.md describes the steps and their errors.
"""
