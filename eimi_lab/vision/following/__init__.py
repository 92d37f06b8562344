"""Following the beam from its clamp, where the picture around it is not dark and bright alone.

Clamp, axis, width and length are known to a few per cent (`stated`, `in_picture`). A picture scaled to the beam's width
(`working`) is searched, without reflections (`gleams`), from the clamp outward by hypotheses of a strip of bounded
curvature (`beam_search`, `hypotheses`).
The strip that is followed best is unrolled (`unrolled`), projected where inside and outside differ most
(`discriminant`), and its two edges are seams of largest fall (`seams`, `colour_seams`), moved off the borders of
shadows (`shadows`), which end where they are sure (`support`).
`edge_points` puts them where a blurred step fitted to the picture itself has them, up to where the beam is as wide as
before (`ends`). `follow` is the way in, and measures what speaks against them.
"""
