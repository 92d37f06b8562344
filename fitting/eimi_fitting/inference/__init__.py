"""Identify a hyperelastic law from measured edges, and compute the uncertainty of the result.

evidence           measurements, unknowns and uncertain inputs; the residuals for given values of the unknowns
searching          the range of moduli, a global search by CMA-ES, and a local improvement by Gauss-Newton
interval           the intervals of the parameters, and the parameters that the data do not determine
doubts             checks of the residuals, and possible causes of large residuals
planning           which states to measure next, the choice of a law, and an estimate of the modulus during a run
corrected_optimum  the optimum with corrections by more accurate beam models, and its intervals
fit                the result of a fit
identification     the whole fit in order, from experiments to a `Fit`
"""
