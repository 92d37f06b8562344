"""Check whether the residuals contradict the model.

checks         compare the residuals with the noise and with the deflection
common_error   an error that all states share: clamp, roll or scale
"""
