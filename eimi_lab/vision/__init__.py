"""From camera frames to the beam's two edges in millimetres.

`edges.find_edges` is the way in: it finds the beam's silhouette in front of the back-light (silhouette),
places each edge to a few hundredths of a pixel on profiles along its normals (profiles, curve), and says what
speaks against the picture (quality). `beam_frame` holds the map between pixels and the beam frame,
`intensity` makes one grey image of a state's frames, `overlay` draws the result, and `benchmark` measures the
error on rendered beams of known shape.
"""
