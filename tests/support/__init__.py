"""What tests in several folders share: `from support.NAME import ...`; pytest puts `tests/` on the path."""
