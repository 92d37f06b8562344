"""Compute the 95 % intervals of the parameters of a fitted hyperelastic law.

covariance           the residuals as linear functions of the unknowns, and the covariance of the optimum
noise                size and correlation of the noise: the residuals that no error of an uncertain input explains
considered           the effect of uncertain inputs, such as the width, on the residuals and on the fitted values
budget               the effect of each uncertain input on the modulus, and the quantity to measure next
draws                random draws from the joint distribution of all uncertain quantities
estimate             the parameters with their intervals
profile_likelihood   the ends of intervals if the objective is not quadratic
identifiability      the combinations of unknowns that the data determine
bootstrap            experiments whose load cases are drawn at random from the measured load cases
cross_validation     the error of a fit in load cases that were omitted from it
"""
