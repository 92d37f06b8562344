"""Identify a hyperelastic law from measured edges, and compute the uncertainty of the result.

evidence           measurements, unknowns and uncertain inputs; the distance from a candidate to the data
searching          the range of moduli, CMA-ES, and Gauss-Newton from its best candidate
interval           covariance, stated uncertainties, intervals and what the data do not determine
doubts             checks of the residuals that a good fit passes
planning           the next measurements, the choice between laws, the modulus during a run
corrected_optimum  from the best candidate of a search to the corrected optimum with its intervals
fit                the result of a fit
identification     the whole fit in order, from experiments to a `Fit`
"""
