"""Watching a scan while it runs: what is known of it, how that is drawn, and the process that does it."""
