"""Where pyserial finds the port that faults are put into."""
