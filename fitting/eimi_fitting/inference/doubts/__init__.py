"""Check whether the residuals of a fit contradict the beam model, and find their probable causes.

checks                the comparison of the residuals with the noise and with the deflection
causes                the probability of each possible error of the test bench (cause of the residuals)
weighing              the comparison of sets of causes, with simulations of the probable sets
cause_doubts          the warning that names the most probable cause
named_error           the intervals of a fit whose residuals have a probable cause, and are therefore not only noise
collinear_causes      groups of causes that change the residuals so alike that the data do not decide between them
edge_coefficients     the description of the residuals by a few coefficients along each edge
marginal_likelihood   the evidence (probability density of the data) of linear Gaussian models
signatures            the change of the residuals by each cause
twisted_picture       the edges of a beam that its magnet has twisted
coefficients          the list of all unknown numbers that may explain the residuals
stated_inputs         the change of the residuals by the inputs with a stated uncertainty
deviating_inputs      the inputs that the residuals show to differ from their stated values
possible_causes       the description of one cause
causes_in_loads, causes_in_pictures, causes_in_specimens   the causes in the loads, the pictures and the specimen
table_of_causes       the list of all causes
"""
