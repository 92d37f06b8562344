"""The evidence of a fit: measurements, unknowns and uncertain inputs, and the distance of a candidate from them.

measurements      edges and tracked points, and their distance from simulated ones
tensile_curves    tensile curves as evidence besides the edges
experiment        one specimen with its loads and measurements, and the comparison of candidates with measurements
sources           every quantity that may be stated as uncertain
parameter_priors  normal priors on the law's parameters
polarity          the sources that both polarities of the field determine
unknowns          the parameters of a fit, and the freed nuisances
objective         the number that a fit minimises, from all the evidence
corrections       the change of the residuals by a finer mesh or a solid
_coarse           coarse meshes and fewer points of each edge for the search
_quadratic        the minimum of a quadratic in the unit cube
quantity          a number with its unit and intervals
"""
