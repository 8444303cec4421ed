"""Constants of nature, exact by definition of the SI."""

#: Speed of light in vacuum [m/s].
C_M_PER_S = 299_792_458.0

#: Planck constant [J s].
H_J_S = 6.62607015e-34
