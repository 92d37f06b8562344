"""Identify the viscoelastic (Prony) law of a soft beam from ring-downs (free vibrations), creep and shapes at rest.

measured         `Motion`, a recorded ring-down or creep
channels         the coordinates of points over time, cleaned of gaps and outliers
decay            frequencies and loss factors of a ring-down
decay_windows    frequency and loss factor in parts of a ring-down
decay_checks     whether the fitted vibrations describe a ring-down
swinging_weight  the vibration of a beam whose hanging weight swings like a pendulum
modal_fit        damped vibrations, fitted to the signals of a ring-down
exposure         the amplitudes of vibrations, corrected for the exposure of the frames
ringing_beam     `RingingBeam`, a specimen under the loads that act during a ring-down
ringing          the frequencies of a specimen's free vibrations, for any viscoelastic law
slow_motion      the rotation of the tip after a step of the load
loaded_creep     creep of a loaded beam for a given viscoelastic law
terms            the unknowns of a viscoelastic law: the modulus and the terms of the Prony series
evidence         residuals of ring-downs and of the sag (bending under the own weight) at rest
slow_evidence    residuals of creep and of shapes at rest
law_of_time      fit to all data: search, least squares, number of terms, and draws from the posterior
small_effects    air, eddy currents, coil, shutter and clamp
result           `LawOfTime`, the result in the form of a file
identification   the whole identification in order
"""
