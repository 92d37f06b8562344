"""What tests and benchmarks share; benchmarks import it from here, and tests import no benchmark.

rendered_edges        frames of beams of known shape, and the errors of edges; `edge_methods` finds edges otherwise
photographs           coloured beams before clutter
lab_photographs       photographs of a bench with one difficulty each, from `lab_scene` and `lab_difficulties`
flag_pictures         a picture for every flag
real_pictures         photographs of other people with traced edges
solid_cases           cases of the solid with known answers
virtual_measurements  measurements with every stated uncertainty drawn; planned_states, before and after a plan
hidden_laws           laws of terms drawn at random
mutated_files         files of every format that is read, changed at random
processes             whether processes live
outside               a package outside of this project, with a supply and a camera
"""
