"""How the image is computed: each solver does the same sum in its own way."""
