"""Identify the viscoelastic (Prony) law of a soft beam from its free vibrations, its creep and its static shapes.

measured         `Motion`, a recorded free vibration or creep
channels         coordinates of points over time, without gaps and outliers
decay            frequencies and loss factors of a free vibration
decay_windows    frequency and loss factor in parts of a free vibration
decay_checks     whether the fitted vibrations describe the recording
swinging_weight  vibration of a beam whose hanging weight swings
modal_fit        fit of damped vibrations to a recording
exposure         amplitudes, corrected for the exposure time of the frames
ringing_beam     `RingingBeam`, a beam with its loads and its undamped frequencies
ringing          frequencies of free vibrations for a viscoelastic law
slow_motion      rotation of the tip after a step of the load
loaded_creep     creep of a loaded beam for a viscoelastic law
terms            unknowns of a viscoelastic law
evidence         residuals of free vibrations and of the sag under the own weight
slow_evidence    residuals of creep and of static shapes
law_of_time      fit of a viscoelastic law to all data
small_effects    estimated effects of air, eddy currents, coil, shutter and clamp
result           `LawOfTime`, the result in the form of a file
identification   the whole identification
"""
