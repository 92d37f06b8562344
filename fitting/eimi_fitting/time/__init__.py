"""Identify the viscoelastic (Prony) law of a soft beam from ring-downs (free vibrations), creep and shapes at rest.

measured         `Motion`, a recorded ring-down or creep
channels         the coordinates of points over time, cleaned of gaps and outliers
decay            frequencies and loss factors of a ring-down
decay_windows    frequency and loss of a ring-down in time windows
decay_checks     whether the fitted vibrations describe a ring-down
swinging_weight  the vibration of a beam whose hanging weight swings like a pendulum
modal_fit        damped vibrations, fitted to the signals of a ring-down
exposure         the amplitudes of a decay, corrected for the exposure of the frames
ringing_beam     `RingingBeam`, a specimen under the loads that act during a ring-down
ringing          the frequencies of a specimen's free vibrations, for any modulus and relaxation
slow_motion      the rotation of the tip after a step of the load
loaded_creep     creep of a loaded beam for a given viscoelastic law
terms            the unknowns of a viscoelastic law: the modulus and the terms of the Prony series
evidence         residuals of ring-downs and of the sag at rest
slow_evidence    residuals of creep and static states
law_of_time      fit to all evidence: search, least squares, number of terms, and draws from the posterior
small_effects    air, eddy currents, coil, shutter and clamp
result           `LawOfTime`, the result in the form of a file
identification   the whole identification in order
"""
