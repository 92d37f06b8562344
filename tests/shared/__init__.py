"""Code that tests and benchmarks share.

accepted_numbers      numbers of a result as text, compared with an accepted text
rendered_edges        frames of beams of known shape, and the errors of detected edges
edge_methods          published methods of edge detection
photographs           coloured beams in front of clutter
lab_photographs       photographs of a bench with one difficulty each
flag_pictures         a picture for every flag (warning about edges)
real_pictures         photographs with edges traced by hand
solid_cases           errors of the solid model against known solutions
estimates             fits that start near their optimum
virtual_measurements  simulated measurements with random errors
planned_states        simulated experiments with equally spaced or planned currents
hidden_laws           random laws
mutated_files         files changed at random
emulated_gige         an emulated GigE camera in a separate process
processes             wait for processes and their effects
supply_transcripts    the messages of every supply driver, with the replies
outside               an example of another person's package with drivers
"""
