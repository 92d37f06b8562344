"""What each command of `eimi` takes and prints; the work is done elsewhere.

bench     instruments, emulate, acquire, recover
images    import, calibrate, segment
laws      fit, validate, tensile, export, simulate
showing   report, demo
watching  dashboard

Every command is a small function; what it needs is imported inside it, so that `eimi --help` is quick. `options` holds
the ones that several commands share; `eimi_lab.cli` puts the commands together.
"""
