"""Gate delayers: what lets a gate open a set time after the laser's sync pulse. One file a product."""
