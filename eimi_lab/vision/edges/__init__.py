"""Both edges of the beam to a few hundredths of a pixel.

`finding.find_edges` is the way in. `back_lit` finds the line of the clamp (`clamp_line`) and the beam's silhouette in
front of the back-light (`silhouette`), places each edge on profiles along its normals in two passes (`passes`,
`profiles`, `uneven_light`, `curve`), and measures what may speak against the picture (`quality`, `dimensions`,
`response`). Where there is none, the beam is followed from its clamp (`eimi_lab.vision.following`).
`edge_set` is the result, and `overlay` draws it on the frame.
"""
