"""The panels (sections) of the report, one in each module, in increasing order of their number `place`.

Panels of the first pages:

first_screen            the result in words, with a picture of the beam and the error by field
causes                  possible causes of the residuals, with their probabilities
published_values        published moduli of the same silicone

Panels of the appendix:

laws                    parameters, misfit and largest stretch of each fit, and the comparison of the laws
uncertainty_budget      the contribution of each source of uncertainty to the interval
causes_of_all_fits      causes of the residuals, for all fits except those on the first pages
law_of_time             viscoelastic (Prony) law: ring-downs, the modulus against time, and creep
parameter_correlation   correlations between the errors of the fitted unknowns
stress_strain           stress against strain of each law
error_boxes             errors at the load steps, by law and specimen
every_fit               the mean error of each fit on each specimen
convergence             smallest error against generation of each search
law_stability           the stretch up to which each law is stable
provenance              files, programs and command line
methods                 a methods paragraph and references

Panels of each dataset:

what_was_measured       specimen, rig, protocol and date
contact_sheet           the first image of each load step, and the defects that checks found
error_against_field     error of each fit at each load step
magnified_residuals     residuals of the best fit as arrows on the beam
residuals_along_beam    residuals of the best fit along the edges
"""
