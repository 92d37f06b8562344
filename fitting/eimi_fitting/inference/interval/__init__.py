"""Estimate how uncertain the best parameters are.

covariance           the linearised evidence and the covariance of the optimum
noise                level and correlation of the noise that the stated sources do not explain
considered           the effect of stated uncertainties on the estimate
budget               the share of each source in the interval
draws                joint draws of all uncertain quantities
estimate             parameters with their intervals
profile_likelihood   interval ends where the objective is not quadratic
identifiability      the combinations of parameters that the data determine
bootstrap            resampled states
cross_validation     errors of states that were left out
"""
