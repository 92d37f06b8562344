"""Find the terms of a hyperelastic law from bending and tensile measurements of one material.

The strain energy of the law is a sum of terms from a library. Each term has one unknown, non-negative coefficient.

rows                 linear equations for the coefficients, divided by the noise
tensile_rows         equations from a tensile curve
bending_rows         equations from the edges of bent beams
supports             the fit of every small set of terms, and the comparison of the sets
terms_of_a_law       all steps in order; the result is one or several sets of terms
"""
