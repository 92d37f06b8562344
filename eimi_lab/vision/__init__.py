"""From camera frames to the beam's two edges in millimetres.

`edges.find_edges` is the way in: it finds the beam's silhouette in front of the back-light (silhouette),
places each edge to a few hundredths of a pixel on profiles along its normals (profiles, uneven_light, curve),
and says what speaks against the picture (quality, dimensions, response). `beam_frame` holds the map between pixels
and the beam frame, `board`, `lens` and `known_width` measure that map, `intensity` makes one grey image of a
state's frames, `overlay` draws the result. `benchmark` and `comparison` measure the error on rendered beams of known
shape, `flag_cases` renders a picture for every flag; README.md holds the figures.
"""
