"""What a fit is made from: measurements, unknowns, uncertain inputs, and the distance between them.

measurements       edges and tracked points, and their distance to simulated ones
tensile_curves     tensile curves as evidence beside the edges
experiment         one specimen, its loads and its measurements
sources            every quantity that may be stated as uncertain
parameter_priors   normal priors on the law's parameters
unknowns           the parameters of a fit, and nuisances that are freed
objective          the weighted sum of all squared residuals
corrections        the change from the coarse model to the better one
_coarse            coarse meshes and thinned edges for the search
_quadratic         minimise a quadratic in the unit cube
quantity           a number with its unit and intervals
"""
