"""The Rayleigh-Sommerfeld diffraction solver, for regular grids and for positions anywhere."""
