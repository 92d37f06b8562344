"""From measured edges to a law and what it is worth.

measurements, experiment       simulated edges and points, their distance to the measured ones; candidates compared
unknowns                       the law's coordinates, the bulk modulus and freed nuisances, each in one entry
tensile_curves, objective      tensile curves beside the edges; all the evidence as one number a candidate
modulus_range, named_causes    between which moduli to search; slips in the loads, told before any search
search, polish, corrections    CMA-ES and Gauss-Newton on a coarse mesh, what a better model changes
identification                 all of it in order, from experiments to a fit
covariance, estimate           the evidence linearised about the optimum; values with intervals
profile_likelihood             their ends where the objective is no quadratic
identifiability, checks        what the data fix, in words; fits that nobody should believe
common_error                   what all states of a dataset are off alike
choice_of_law                  which law the data support
cross_validation, bootstrap    states left out, and states drawn again
sensitivity                    derivatives of the edges
"""
