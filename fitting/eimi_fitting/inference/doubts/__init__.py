"""Check whether the residuals of a fit contradict the beam model, and weigh the possible causes of the residuals.

checks                the comparison of the residuals with the noise and with the deflection
causes                the probability of each possible cause of the residuals
weighing              the comparison of the hypotheses (sets of causes), with simulations of the probable ones
cause_doubts          the doubt that names the most probable cause
named_error           the intervals of a fit if the most probable causes of the residuals are not noise
collinear_causes      groups of causes that change the residuals so alike that the data do not decide between them
edge_coefficients     the description of the residuals by a few coefficients along each edge
marginal_likelihood   the evidence (probability density of the data) of linear Gaussian models
signatures            the change of the residuals by each possible cause
twisted_picture       the edges of a beam that its magnet has twisted
coefficients          the coefficients of all hypotheses about the causes
stated_inputs         the inputs with a stated uncertainty, which are uncertain under every hypothesis
deviating_inputs      the deviations of such inputs that the residuals show
possible_causes       the description of a possible error of a bench
causes_in_loads, causes_in_pictures, causes_in_specimens   the possible errors, by what they belong to
table_of_causes       all possible errors
"""
