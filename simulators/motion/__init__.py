"""The steering mirror and its mount, in angles: nothing here knows a device's units or any light."""
