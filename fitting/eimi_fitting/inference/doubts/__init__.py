"""Check whether the residuals of a fit contradict the beam model, and weigh the possible causes of the residuals.

checks                the comparison of the residuals with the noise and with the deflection
causes                the probability of each possible cause of the residuals
weighing              the comparison of the hypotheses about the causes, with simulations of the probable ones
cause_doubts          the doubt that names the most probable cause
named_error           the intervals of a fit if the most probable causes of the residuals are not noise
collinear_causes      groups of causes that change the residuals so alike that the data do not decide between them
edge_coefficients     the description of the residuals by a few coefficients along each edge
marginal_likelihood   the evidence (probability density of the data) of linear Gaussian models
signatures            the change of the residuals by each possible cause
twisted_picture       the edges of a beam that its magnet has twisted
possible_causes       the possible errors of a bench, each with the measurement that decides about it
"""
