"""Measuring: devices opened, a plan run, the photons handed on."""
