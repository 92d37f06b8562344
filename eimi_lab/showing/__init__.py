"""What figures and tables have in common.

drawing   the style of all figures
palette   their colours
tables    print tables, and load the packages that draw or tabulate
"""
