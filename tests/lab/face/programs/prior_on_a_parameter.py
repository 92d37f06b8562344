"""Fit a law with a prior on C10, because bending alone hardly distinguishes the parameters C10 and C01."""

import eimi_lab as eimi

without = eimi.fit("run.h5", "mooney-rivlin")
with_prior = eimi.fit("run.h5", "mooney-rivlin", prior=eimi.Prior("C10", 16e3, 400.0))
print(with_prior)
result = (
    without.identifiability.not_fixed,
    with_prior.identifiability.not_fixed,
    with_prior.parameters["C10"].interval_95,
)
