"""The data of a fit of a hyperelastic law (its evidence), the unknowns, the uncertain inputs, and the objective.

measurements      measured edges and tracked points, and the distance from simulated edges and points
tensile_curves    tensile curves as evidence besides the edges
experiment        one specimen with its loads and measurements, and the comparison of candidates with measurements
sources           every input whose uncertainty a file may specify
parameter_priors  normal priors on the law's parameters
polarity          the uncertain inputs that a measurement in both polarities of the field determines
unknowns          the parameters of a fit, and the uncertain inputs that it determines (freed nuisances)
objective         the number that a fit minimises, computed from all the evidence
corrections       the change of the residuals by a finer mesh or a three-dimensional model
_coarse           coarse meshes and fewer points of each edge for the search
_quadratic        the minimum of a quadratic in the unit cube
quantity          a number with its unit and intervals
"""
