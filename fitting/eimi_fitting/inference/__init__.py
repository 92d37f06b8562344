"""Identify a hyperelastic law from measured edges, with the uncertainty of its parameters.

evidence           measurements, unknowns, uncertain inputs, and residuals
searching          range of moduli, global search, and local improvement
interval           intervals of the parameters, and parameters that the data do not determine
doubts             checks of the residuals, and possible causes of large residuals
planning           choice of load cases and of a law, and the modulus during a run
corrected_optimum  optimum with corrections of the beam model, and its intervals
fit                the result of a fit
identification     the whole fit, from experiments to a `Fit`
"""
