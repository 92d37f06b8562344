"""Tools of the process itself, which every other room may use.

errors        what a person did wrong, and how it is printed
progress      progress bars, or plain lines where there is no terminal
stopping      signals that end the program, and the exception that they raise
stderr        keep what foreign libraries print on standard error
threads       limit the threads of numerical libraries
garbage       collect garbage less often while arrays are made
workers       share tasks among processes
writer_lock   one writer for each dataset
outputs       write a result file as a whole or not at all
"""
