"""Work with the operating system: processes, files, the terminal, signals, memory and the log.

errors         define the error for wrong input, and print messages
progress       show the progress of long work
stopping       end the program in an orderly way after a signal
stderr         write to standard error without waiting for a reader
threads        use one thread for linear algebra
garbage        collect garbage less often, and reuse freed memory
workers        distribute tasks to processes or a cluster
awake          keep the computer from sleeping during a run
scope          move a process into a separate systemd scope
console        read typed lines, and react to the closing of the terminal
detached       start processes that outlive their terminal, and set priorities
pipes          read and write pipes between processes
paths          handle long paths on Windows, and symbolic links
writer_lock    allow one writer at a time for each file
log            print the log for maintainers
limits         limit memory and processor time
replacing      replace and remove files that another program may have open
synchronising  write a file to the disk while the calling thread does something else
outputs        write result files completely or not at all
"""
