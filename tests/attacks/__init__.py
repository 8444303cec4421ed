"""Attacks: generated and mutated input for everything that reads text or bytes from outside."""
