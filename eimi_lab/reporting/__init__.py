"""The report: one HTML file that holds everything it shows.

shown        the fits of all files, by their names, colours and marks
simulated    the fits, simulated again for the datasets that are shown
steps        the same in steps, which workers share
contents     both, as the panels are given them
findings     what it all comes to: the number, what limits it, whether to believe it
panel        what a panel is; `panels` holds one a file
drawn_panels what they show, drawn as soon as it is known
elements     numbered figures and tables, as HTML and as files of their own
frames, stress, numbers, citation    what panels have in common
page         fills page.html with the panels
"""
