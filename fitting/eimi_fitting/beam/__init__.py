"""The beam: specimen and loads in, its shape in every state out, for many candidates at once.

Planar: `model` (BeamModel) on `grid`, `mesh`, `element`. Solid: `solid_model` (SolidModel) on `solid_grid`, `bricks`,
`brick`, `isotropy`; `beside`, from planar shapes. Both: `loads`, `rigid`, `equilibrium` (Newton), `system` and `band`
(linear algebra), `path` (states one after another), `outline` (the edges that a camera sees), `view` (its lens).
"""
