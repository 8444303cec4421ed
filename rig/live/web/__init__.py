"""A scan that runs, shown in a browser: a small server, and the page that it gives."""
