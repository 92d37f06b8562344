"""Compute the 95 % intervals of the parameters of an identified hyperelastic law.

covariance           the residuals as linear functions of the unknowns, and the covariance of the optimum
noise                level and correlation of the noise: the residuals without the effects of uncertain inputs
considered           the effect of stated uncertainties on the estimate
budget               the contribution of each source of uncertainty to the interval
draws                random draws from the joint distribution of all uncertain quantities
estimate             parameters with their intervals
profile_likelihood   the ends of intervals if the objective is not quadratic
identifiability      the combinations of parameters that the data determine
bootstrap            experiments whose states are drawn at random from the measured states
cross_validation     errors of states that were omitted from the fit
"""
