"""The parts that all figures and tables of results have in common.

drawing      the style of figures, and figures as files
palette      colours, markers and line styles
significant  numbers with their significant digits
tables       HTML tables for a notebook, and data frames
"""
