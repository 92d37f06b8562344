"""Materials, finite elements and identification for soft beams: values in, values out.

The beam
specimen                    what it is made of and where its magnet sits
materials, stability        hyperelastic laws and their derivatives; up to which stretch one is Drucker-stable
grid, mesh, element         quadrilaterals with quadratic displacement and linear pressure, for a whole batch
rigid, actuation, pressure  a rigid magnet in the silicone; its torque, gravity and other loads; pressure on a face
band, system, solid         the linear algebra of a batch, and Newton's method over it
forward, sensitivity        many candidates at once through all states; the derivatives of their edges

The identification
observation, experiment     simulated edges and points, their distance to the measured ones; candidates judged by it
search_space, nuisance      the unknowns: of the law, and beside it
tensile_evidence, problem   tensile curves beside the edges; all the evidence as one number a candidate
coarse, search, polish      CMA-ES on a coarse mesh, then Gauss-Newton on a finer one
mesh_error                  what a still finer one changes
identification              all of it in order, from experiments to a fit
bootstrap                   experiments with their states drawn again

What a fit is worth
correlation, linearised     how many points count as one; the evidence about the optimum as a quadratic
uncertainty, profile        intervals; their ends where the objective is no quadratic
directions, credibility     what the data fix, in words; fits that nobody should believe
model_choice                which law the data support

tensile                     the conventional route: least squares on a tensile curve
export                      a law as a material card of other programs

Knows no files and no instruments; needs numpy, scipy and cma alone.
"""
