"""Estimate the uncertainty of the identified parameters, as 95 % intervals.

covariance           the linearised evidence and the covariance of the optimum
noise                level and correlation of the noise that the stated sources do not explain
considered           the effect of stated uncertainties on the estimate
budget               the share of each source in the interval
draws                joint draws of all uncertain quantities
estimate             parameters with their intervals
profile_likelihood   ends of intervals if the objective is not quadratic
identifiability      the combinations of parameters that the data determine
bootstrap            experiments with states drawn again at random
cross_validation     errors of states that were omitted from the fit
"""
