"""Code that tests and benchmarks share: benchmarks import it from here, and tests import no benchmark.

rendered_edges        frames of beams of known shape, and the errors of detected edges
edge_methods          published methods of edge detection
photographs           coloured beams in front of clutter
lab_photographs       photographs of a bench with one difficulty each, from `lab_scene` and `lab_difficulties`
flag_pictures         a picture for every flag (warning about edges)
real_pictures         photographs of other people, with edges traced by hand
solid_cases           errors of the solid model against known solutions
estimates             fits that start near their optimum, without search and causes
virtual_measurements  measurements with every uncertain value drawn at random
planned_states        experiments before and after a plan of their states
hidden_laws           laws of terms drawn at random
mutated_files         datasets and other files changed at random
emulated_gige         an emulated GigE camera in a separate process
processes             wait for processes and their effects
supply_transcripts    the messages of every supply driver, with the replies
outside               an example of another person's package, with drivers of a supply and a camera
"""
