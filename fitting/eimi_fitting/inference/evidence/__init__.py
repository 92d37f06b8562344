"""The parts of a fit of a hyperelastic law: measured data, unknowns, uncertain inputs, and the objective.

measurements      measured edges and tracked points, and their distances from the simulated beam
tensile_curves    tensile curves that are fitted together with the edges
experiment        one specimen with its loads and measurements, and the comparison of simulations with measurements
sources           the inputs of a simulation that may be uncertain, such as the width of the specimen
parameter_priors  normal priors on the parameters of the law
polarity          the uncertain inputs that can be fitted if the field was measured in both directions
unknowns          the unknowns of a fit: the parameters of the law, and uncertain inputs
objective         the quantity in mm that a fit minimises
corrections       the change of the residuals by a finer mesh or a three-dimensional model
_coarse           coarse meshes and fewer points of each edge, for a fast first search
_quadratic        the minimum of a quadratic function in the unit cube
quantity          a value with its unit and intervals
"""
