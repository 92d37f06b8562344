"""Materials, finite elements and identification for soft beams: values in, values out.

specimen        what the beam is made of and where its magnet sits
materials       hyperelastic laws and their derivatives; stability tells where a law is Drucker-stable
mesh, element   quadrilaterals with quadratic displacement and linear pressure, evaluated for a whole batch
actuation       magnet torque, gravity and tip force as dead loads
band, forward   Newton over the batch: many candidates at once through all field states
observation     simulated edges and points, and their distance to the measured ones
identification  CMA-ES over scaled parameters; uncertainty says what the result is worth
tensile         the conventional route: least squares on a tensile curve
export          a law as a material card of other programs

Knows no files and no instruments; needs numpy, scipy and cma alone.
"""
