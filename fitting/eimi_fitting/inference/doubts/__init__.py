"""Check whether the residuals of a fit contradict the beam model, and find the probable bench errors.

A bench error (cause) is a wrong assumption of a fit, such as a wrong scale of the picture.

checks                the limits for large residuals, and the warnings about a fit
causes                the probability of each bench error
weighing              the comparison of sets of bench errors
cause_doubts          the warning that names the most probable bench error
named_error           the intervals of a fit with a probable bench error
collinear_causes      groups of bench errors with similar effects
edge_coefficients     polynomials that describe the residuals along each edge
marginal_likelihood   the evidence (probability density of the data) of linear models
signatures            the change of the residuals by each bench error
twisted_picture       the edges of a beam that its magnet has twisted
coefficients          the list of all unknowns that may explain the residuals
stated_inputs         the change of the residuals by the inputs with an uncertainty
deviating_inputs      the inputs that differ from their stated values
possible_causes       the description of one bench error
causes_in_loads, causes_in_pictures, causes_in_specimens   the bench errors of loads, pictures and specimen
table_of_causes       the list of all bench errors
"""
