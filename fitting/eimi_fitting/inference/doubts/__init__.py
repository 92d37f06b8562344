"""Check whether the residuals contradict the model, and weigh the possible causes.

checks                compare the residuals with the noise and with the deflection
causes                weigh the possible causes of the residuals by their evidence
collinear_causes      classes of causes that the residuals do not distinguish
edge_coefficients     residuals as few coefficients along each edge
marginal_likelihood   the evidence of linear Gaussian models
signatures            the change of the residuals by each possible cause
possible_causes       the possible errors of a bench, and decisive measurements
"""
