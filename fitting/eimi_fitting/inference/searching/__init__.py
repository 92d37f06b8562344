"""Find the parameters of a law that minimise the objective of a fit, by a global search and a local improvement.

modulus_range        the range of moduli that the data allow
named_causes         mistakes in the loads that explain why no material fits
measured_rest_shape  the stress-free shape of the specimen, measured without load
search               the global search, by CMA-ES
_cma                 import of the package cma without its plots
polish               the local improvement, by Gauss-Newton
"""
