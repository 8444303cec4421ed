"""Gate delayers: boxes that give the detector its gate pulse a settable time after the laser's sync pulse."""
