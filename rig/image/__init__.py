"""From a scan file to a volume: calibrations applied, a solver run, the result measured."""
