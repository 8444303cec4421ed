"""How the roof builds a simulated bench, and what it can do without devices."""
