"""The forward model: a specimen, a law and loads in, the shape of the beam in every state out.

bending (`Beam`) is the public face. specimen, loads, actuation and kinds_of_load state what is given.
Planar: model (`BeamModel`) on grid, mesh, element and pressure. Solid: solid_model (`SolidModel`) on solid_grid,
bricks, brick and isotropy; beside (`SolidBeside`) solves a solid from its planar model by way of depth_effect.
Both: rigid (the magnet), equilibrium (Newton's method), system and band (linear algebra), path (one state after
another), outline (the edges that a camera sees), view (the camera's lens).
"""
