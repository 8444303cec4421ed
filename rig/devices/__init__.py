"""The kinds of devices that a configuration can name, and how each is opened at its wire."""
