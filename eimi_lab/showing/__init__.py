"""The common parts of all figures and tables of results.

drawing      the style of figures, and figures as files
palette      colours, markers and line styles
rounded      a quantity with its interval and its unit
significant  numbers with their significant digits
tables       HTML tables for a notebook, and data frames
"""
