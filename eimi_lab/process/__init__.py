"""What all other packages need from the operating system: processes, files, the terminal, signals, memory and the log.

errors         errors caused by the user's input, and messages in one line
progress       progress bars, or plain lines without a terminal
stopping       signals that stop the program, and the exception that they raise
stderr         a stream for standard error that never blocks the program
threads        use one thread for linear algebra
garbage        less frequent garbage collection, and reuse of freed memory
workers        distribution of tasks to processes or a cluster
awake          keep the computer from sleeping during a run
scope          a separate systemd scope for a process
console        lines typed on the terminal, and the closing of the terminal
detached       processes that outlive their terminal, and the priority of processes
pipes          pipes between processes
paths          long paths on Windows, and symbolic links
writer_lock    one writer at a time for each file
log            the log for a maintainer, off by default
limits         limits of memory and processor time
replacing      replace and remove files that another program may have open
synchronising  write a file to the disk while the calling thread does something else
outputs        result files that are written completely or not at all
"""
