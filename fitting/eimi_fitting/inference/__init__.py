"""Identify a hyperelastic law from measured edges, with the uncertainty of its parameters.

evidence        measurements, unknowns, uncertain inputs, and residuals
searching       range of moduli, global search, and local improvement
interval        corrected optimum with its intervals, and parameters that the data do not determine
doubts          checks of the residuals, and possible causes of large residuals
planning        choice of load cases and of a law, and the modulus during a run
identification  the whole fit, from experiments to a `Fit`
"""
