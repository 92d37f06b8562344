"""The report: one HTML file that holds everything it shows.

simulation   the identified laws, simulated again for the datasets that are shown
figures      each picture, from numbers to an embedded image
page         gathers text, tables and figures and fills page.html
"""
