"""The common parts of all figures and tables.

drawing  the style of figures, and figures as files
palette  colours, markers and line styles
tables   HTML tables for a notebook, and data frames
"""
