"""From the evidence to the best parameters: global search and local refinement.

modulus_range   the range of moduli that the data allow
named_causes    slips in the loads that no material explains
search          CMA-ES in the unit cube
_cma            import the package cma without its plotting parts
polish          Gauss-Newton from the best candidate
"""
