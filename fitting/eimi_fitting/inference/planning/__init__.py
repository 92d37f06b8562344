"""Choose the next measurements and the law.

design_of_experiment   the states that narrow an interval most
exchange               choose some of many candidates by exchange
choice_of_law          compare laws by AICc and BIC
modulus_so_far         the modulus during a run
section_bias           the error of the modulus in a planar section
compressibility        the error of the modulus of a material that is not incompressible
sensitivity            derivatives of the edges
"""
