"""Find the terms of a hyperelastic law from bending and tensile measurements of one material.

The energy of the law is a sum of terms from a library, each with one unknown, non-negative coefficient.

rows                 linear equations for the coefficients, divided by the noise of the measurement
tensile_rows         turn a tensile curve into such equations, exactly: stress is linear in the coefficients
bending_rows         turn the edges of bent beams into such equations, linearised about a law close to the solution
supports             fit every small set of terms, and compare the sets by their cross-validation error
terms_of_a_law       do all steps in order and state the terms, or state that they are not identifiable
"""
