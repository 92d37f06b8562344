"""Check whether the residuals of a fit contradict the beam model, and find the probable systematic errors.

A systematic error (cause) is a wrong assumption of a fit, such as a wrong scale of the picture.

checks                the limits for large residuals, and the warnings about a fit
causes                the probability of each systematic error
weighing              the comparison of all pairs of systematic errors
cause_doubts          the warning that names the most probable systematic error
named_error           the intervals of a fit with a probable systematic error
collinear_causes      groups of systematic errors with similar effects
edge_coefficients     polynomials that describe the residuals along each edge
marginal_likelihood   the evidence (probability density of the data) of linear models
signatures            the change of the residuals by each systematic error
twisted_picture       the edges of a beam that its magnet has twisted
coefficients          the list of all unknowns that may explain the residuals
stated_inputs         the change of the residuals by each uncertain input
deviating_inputs      the uncertain inputs that are probably wrong
possible_causes       the description of one systematic error
causes_in_loads       the systematic errors of the loads
causes_in_pictures    the systematic errors of the pictures
causes_in_specimens   the systematic errors of the specimen
table_of_causes       the list of all systematic errors
"""
