"""Asking all devices harmless questions, keeping what passed, and telling what it settles."""
