"""The panels of the report, a file each; the page shows them in the order of their places.

laws               parameters, misfit and range of every fit, and the comparison of the laws
uniaxial_tension   stress against strain of every law
every_fit          every fit on every specimen
frames, points     what was measured of a dataset, with the best fit over it
errors_by_state    error of every fit in every state of a dataset
largest_state      every fit over what was measured, in the state of the largest load
residuals          what the best fit leaves along the edges
search             how each search went

A new file with a `PANEL` is a new panel; `eimi_lab.reporting.panel` says what one is.
"""
