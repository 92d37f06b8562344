"""The report: one HTML file that holds everything it shows.

shown        the fits of all files, by their names and colours
simulation   the fits, simulated again for the datasets that are shown
stress       stress against strain in uniaxial tension, with bands, and the tensile tests themselves
figures      pictures of one fit: frames, residuals, the search
law_panels   pictures with a panel a law, of all fits: errors by state, shapes, stress
page         gathers text, tables and figures and fills page.html
"""
