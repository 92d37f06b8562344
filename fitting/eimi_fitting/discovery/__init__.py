"""Which terms a law is made of, from bending and tensile evidence together.

rows                 evidence that is linear in the terms' coefficients, in units of its noise
tensile_rows         a tensile curve as such rows, which it is
bending_rows         bent beams as such rows, about a law that is near
supports             all small sets of terms by the error of what was left out, and which of them the data tell apart
terms_of_a_law       all of it in order: from experiments and curves to terms, or to "not identifiable"
"""
