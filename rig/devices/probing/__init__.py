"""What each kind of device can be asked without harm, and what its answers settle."""
