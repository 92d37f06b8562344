"""Whether the residuals contradict the model, and what may be the cause.

checks                compare the residuals with the noise and with the deflection
causes                weigh the possible causes of the residuals by their evidence
edge_coefficients     residuals as few coefficients along each edge
marginal_likelihood   the evidence of linear Gaussian models
signatures            the change of the residuals by each possible cause
possible_causes       what may be wrong on a bench, and what decides on it
"""
