"""Compute the 95 % intervals of the parameters of a fitted hyperelastic law.

corrected_optimum    the optimum with corrections of the beam model, and its intervals
covariance           the derivatives of the residuals at the optimum, and the covariance of the optimum
noise                the part of the residuals that no error of an uncertain input explains
considered           the effect of uncertain inputs, such as the width, on the residuals and on the fitted values
budget               the effect of each uncertain input on the modulus, and the quantity to measure next
draws                random draws of all uncertain quantities
estimate             the parameters with their intervals
profile_likelihood   the ends of asymmetric intervals
identifiability      the combinations of unknowns that the data determine
bootstrap            experiments whose load cases are drawn at random from the measured load cases
cross_validation     the error of a fit in load cases that were omitted from it
"""
