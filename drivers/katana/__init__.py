"""The Onefive/NKT Katana HP pulsed laser."""
