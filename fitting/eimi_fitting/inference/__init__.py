"""Identify a hyperelastic law from measured edges, and compute the uncertainty of the result.

evidence           measurements, unknowns and uncertain inputs; the residuals of a candidate law
searching          the range of moduli, the search by CMA-ES, and Gauss-Newton from the best candidate
interval           the intervals of the parameters, and the parameters that the data do not determine
doubts             checks of the residuals, and possible causes of large residuals
planning           the next measurements, the choice between laws, the modulus during a run
corrected_optimum  the optimum with the corrections by better models, and its intervals
fit                the result of a fit
identification     the whole fit in order, from experiments to a `Fit`
"""
