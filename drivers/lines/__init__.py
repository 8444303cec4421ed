"""What devices hang on: serial lines and USB."""
