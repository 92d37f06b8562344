"""Choose the next load cases to measure, and the hyperelastic law.

design_of_experiment   the load cases that give the narrowest interval
rival_laws             the load cases that distinguish two laws
exchange               the search for a good choice of load cases
choice_of_law          the comparison of laws by AICc and BIC
modulus_so_far         an estimate of the modulus during a run
section_bias           the error of the modulus due to a planar model of a solid beam
compressibility        the error of the modulus if the material is compressible
sensitivity            the derivatives of the edges by the parameters of a law
"""
