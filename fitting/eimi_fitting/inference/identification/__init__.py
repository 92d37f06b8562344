"""Identify a hyperelastic law from experiments.

whole_fit  the whole fit, from experiments to a `Fit`
fit        the result of a fit
"""
