"""What is learnt by counting steady light: dark counts, afterpulses, bin widths."""
