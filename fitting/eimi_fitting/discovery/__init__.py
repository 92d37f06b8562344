"""Find the terms of a hyperelastic law from bending and tensile measurements of one material.

The energy of the law is a sum of terms from a library (a list of possible terms). Each term has one unknown,
non-negative coefficient.

rows                 linear equations for the coefficients, divided by the noise of the measurement
tensile_rows         equations from a tensile curve, which are exact: stress is linear in the coefficients
bending_rows         equations from the edges of bent beams, linearised about a law close to the solution
supports             the fit of every small set of terms, and the comparison of these sets by cross-validation
terms_of_a_law       all steps in order; the result is one set of terms, or several if the data do not decide
"""
