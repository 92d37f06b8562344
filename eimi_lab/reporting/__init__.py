"""Write the report: one HTML file that contains all its figures and tables.

shown          read the fits of all files, and give each fit a label and a style
sections       choose the model of the cross-section with which each fit is simulated
contents       the fits, datasets and predictions that the panels of a report show
findings       the result in words: modulus, interval, largest sources of uncertainty, reliability
error_at_a_glance  draw the error of each dataset over the magnetic field
residual_noise   test whether the residuals of a fit look like noise
panel          the properties of a panel of the report: place, title, template and values
panels         the panels (sections of the report), one in each module
drawn_panels   draw each panel as soon as its contents are available
elements       number figures and tables, and write them as HTML and as files
frames         cut frames to the beam, and choose load steps to show
stress         compute stress against strain of each fit in three modes of deformation
published_moduli  published moduli of common silicones
citation       the references to cite
page           fill page.html with the panels
"""
